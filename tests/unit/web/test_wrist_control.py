"""Holders of wrists and the resulting samples; true pose of a person who uses the mouse."""

import itertools
import math

import pytest

import pointit.schemas as models
from pointit.bridges.web.config import Place, WebConfig
from pointit.bridges.web.wire import AimAt, Turn
from pointit.bridges.web.wrists.wrist_control import AssumedPose, WristControl, choose_pose, middle, places
from pointit.geometry import rotation, vector
from pointit.schemas.person import RayModel
from pointit.services.pointing.pointer import ArmRay
from tests.support import there

START = 1_700_000_000 * models.NS_PER_S
TICK = models.NS_PER_S // 60
UP = (0.0, 0.0, 0.0, 1.0)


def at(seconds: float) -> int:
    return START + round(seconds * models.NS_PER_S)


def turn(t_ms: float = 5.0, session: int = 0, q: tuple[float, float, float, float] = UP) -> Turn:
    return Turn(q=q, t_ms=t_ms, session=session, battery=0.5)


@pytest.fixture
def wrists() -> WristControl:
    return WristControl(WebConfig(places={"anna": Place(position_m=(1.0, 0.0, 0.0), yaw_deg=30.0)}))


def aim(wrists: WristControl, page: str, *, user: str = "anna") -> bool:
    return wrists.aim(page, AimAt(user=user, at_m=(4.0, 2.0, 1.0)))


def only(samples: list[tuple[str, models.WristSample]], user: str = "anna") -> models.WristSample:
    assert [name for name, _ in samples] == [user]
    return samples[0][1]


def test_held_arm_sends_a_sample_at_every_step(wrists: WristControl) -> None:
    wrists.acquire("anna", "page1", "mouse")
    assert aim(wrists, "page1")
    samples = [only(wrists.step(START + k * TICK)) for k in range(5)]
    assert [sample.seq for sample in samples] == [1, 2, 3, 4, 5]
    assert {sample.orientation_xyzw for sample in samples} == {samples[0].orientation_xyzw}
    assert {sample.device for sample in samples} == {"arm"}
    assert samples[2].stamp_ns == START + 2 * TICK


@pytest.mark.parametrize("ray_model", ["eye_finger", "shoulder_arm", "forearm"])
def test_arm_meets_the_mouse_as_seen_from_the_pose(wrists: WristControl, ray_model: RayModel) -> None:
    body = models.BodyMeasures(
        footprint_to_neck_m=1.1,
        neck_to_eyes_m=0.15,
        neck_to_shoulder_m=0.25,
        shoulder_to_wrist_m=0.5,
        wrist_to_finger_m=0.1,
    )
    profile = models.UserProfile(stamp_ns=0, body=body, hand="left", ray_model=ray_model)
    wrists.profile("anna", profile)
    wrists.pose("anna", models.UserPose(stamp_ns=0, position_m=(-1.0, 2.0, 0.0), yaw_rad=1.0))
    wrists.acquire("anna", "page1", "mouse")
    aim(wrists, "page1")

    origin, direction = there(ArmRay.from_profile(profile).ray(only(wrists.step(START)).orientation_xyzw))
    start_m = vector.add((-1.0, 2.0, 0.0), vector.rotate_z(origin, 1.0))
    sight = vector.subtract((4.0, 2.0, 1.0), start_m)
    assert vector.angle_between(vector.rotate_z(direction, 1.0), sight) < 1e-6


def test_arm_uses_the_true_pose_during_a_localization(wrists: WristControl) -> None:
    wrists.acquire("anna", "page1", "mouse")
    aim(wrists, "page1")
    before = only(wrists.step(at(0.0))).orientation_xyzw
    wrists.localization("anna", progress("sampling"))
    wrists.pose("anna", models.UserPose(stamp_ns=0, position_m=(9.0, 9.0, 0.0), yaw_rad=0.0))
    wrists.localization("anna", progress("sampling"))
    assert only(wrists.step(at(1.0))).orientation_xyzw == before
    wrists.localization("anna", progress("solved"))
    assert only(wrists.step(at(2.0))).orientation_xyzw != before


def test_last_page_that_takes_the_wrist_has_it(wrists: WristControl) -> None:
    assert wrists.acquire("anna", "page1", "mouse") == ""
    assert wrists.acquire("anna", "page1", "mouse") == ""
    assert wrists.acquire("anna", "page2", "mouse") == "page1"
    assert not aim(wrists, "page1")
    assert aim(wrists, "page2")
    assert not wrists.release_from("anna", "page1")
    assert wrists.release_from("anna", "page2")
    assert wrists.step(START) == []


def test_wrists_of_people_are_independent(wrists: WristControl) -> None:
    wrists.acquire("anna", "page1", "mouse")
    wrists.acquire("ben", "page2", "mouse")
    assert not aim(wrists, "page1", user="ben")
    assert not aim(wrists, "page1", user="nobody")
    assert [user for user, _ in wrists.step(START)] == ["anna", "ben"]
    assert wrists.close("page1") == ["anna"]
    assert [user for user, _ in wrists.step(START)] == ["ben"]
    wrists.forget("ben")
    assert wrists.step(START) == []


def test_phone_takes_the_wrist_by_its_first_turn(wrists: WristControl) -> None:
    held = rotation.from_axis_angle((1.0, 0.0, 0.0), 0.3)
    sample = there(wrists.turn("anna", "phone1", turn(12.5, q=held), START))
    assert (sample.device, sample.orientation_xyzw) == ("phone", held)
    assert (sample.device_time_ns, sample.battery, sample.stamp_ns) == (12_500_000, 0.5, START)
    assert wrists.holder("anna") == ("phone1", "phone")


def test_phone_that_lost_the_wrist_must_request_it(wrists: WristControl) -> None:
    wrists.turn("anna", "phone1", turn(), START)
    assert wrists.acquire("anna", "page1", "mouse") == "phone1"
    assert wrists.turn("anna", "phone1", turn(), START) is None
    wrists.release_from("anna", "page1")
    assert wrists.turn("anna", "phone1", turn(), START) is None
    assert wrists.acquire("anna", "phone1", "phone") == ""
    assert wrists.turn("anna", "phone1", turn(), START) is not None
    assert wrists.release("anna") == "phone1", "an operator takes it back"
    assert wrists.turn("anna", "phone1", turn(), START) is None
    assert wrists.release("anna") == ""


def test_still_phone_repeats_its_sample_five_times_a_second(wrists: WristControl) -> None:
    wrists.turn("anna", "phone1", turn(), START)
    sent = [START]
    for k in range(1, 60):
        sent += [sample.stamp_ns for _, sample in wrists.step(START + k * TICK)]
    gaps = [b - a for a, b in itertools.pairwise(sent)]
    assert 4 <= len(gaps) <= 6
    assert max(gaps) <= 0.2 * models.NS_PER_S


@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_silent_phone_releases_the_wrist_until_it_returns(wrists: WristControl, speed: float) -> None:
    wrists.turn("anna", "phone1", turn(), at(0.0))
    assert wrists.step(at(0.9 * speed), speed) != []
    assert wrists.step(at(1.1 * speed), speed) == []
    assert wrists.holder("anna") == ("", "own")
    assert wrists.turn("anna", "phone1", turn(), at(3.0 * speed)) is not None


def test_sessions_of_phones_have_different_numbers(wrists: WristControl) -> None:
    def number(page: str, session: int, seconds: float) -> int:
        wrists.acquire("anna", page, "phone")
        return there(wrists.turn("anna", page, turn(session=session), at(seconds))).session

    first = number("phone1", 0, 0.0)
    again = number("phone1", 0, 0.1)
    loaded = number("phone1", 1, 0.2)
    other = number("phone2", 0, 0.3)
    assert first == again
    assert len({first, loaded, other}) == 3
    assert number("phone1", 1, 0.4) == loaded
    for session in range(100):
        number("phone1", session, 1.0 + session)
    assert len(wrists._people["anna"].sessions) <= 16


def test_tremor_is_set_only_by_the_holder(wrists: WristControl) -> None:
    wrists.acquire("anna", "page1", "mouse")
    assert not wrists.set_tremor("anna", "page2", 1.0)
    assert wrists.set_tremor("anna", "page1", 1.0)
    assert wrists.step(at(0.0))[0][1] != wrists.step(at(0.1))[0][1]
    samples = [only(wrists.step(at(1.0 + 0.02 * k))).orientation_xyzw for k in range(3)]
    assert len(set(samples)) == 3
    assert not wrists.set_tremor("nobody", "page1", 1.0)


def test_status_line_shows_the_state_of_a_phone(wrists: WristControl) -> None:
    line = wrists.line("anna", START)
    assert (line.moved_by, line.is_mine, line.phone, line.battery) == ("own", False, "", None)
    assert line.assumed is not None
    assert line.assumed.position_m == (1.0, 0.0, 0.0)
    assert line.assumed.yaw_rad == pytest.approx(math.radians(30.0))
    assert wrists.line("ben", START).assumed is None

    wrists.acquire("anna", "page1", "mouse")
    assert wrists.users_of("page1") == {"anna"}
    assert wrists.users_of("page2") == frozenset()
    assert wrists.line("anna", START, paired="phone1").phone == "waiting for the phone"

    wrists.turn("anna", "phone1", turn(), START)
    line = wrists.line("anna", START, paired="phone1")
    assert (line.moved_by, line.is_mine, line.battery) == ("mouse", False, 0.5)
    assert line.phone == "connected, does not move the arm"

    wrists.acquire("anna", "phone1", "phone")
    assert wrists.line("anna", START, paired="phone1").phone == "moves the arm"
    assert wrists.users_of("page1") == frozenset()
    assert wrists.line("anna", at(2.0), paired="phone1").phone == "paired, but silent"


def test_direction_ahead_is_the_middle_of_the_map(wrists: WristControl) -> None:
    belt = models.Belt(id="b", line_m=((5.0, -1.0, 1.0), (5.0, 1.0, 1.0)))
    wrists.room(models.Environment(stamp_ns=0, name="hall", belts=(belt,)))
    wrists.pose("anna", models.UserPose(stamp_ns=0, position_m=(5.0, -3.0, 0.0), yaw_rad=0.5))
    assert wrists.ahead("anna") == pytest.approx(math.pi / 2 - 0.5)


def test_late_map_moves_people_without_a_place(wrists: WristControl) -> None:
    wrists.acquire("ben", "page1", "mouse")
    aim(wrists, "page1", user="ben")
    before = only(wrists.step(at(0.0)), "ben").orientation_xyzw
    belt = models.Belt(id="b", line_m=((-3.0, 8.0, 1.0), (3.0, 8.0, 1.0)))
    wrists.room(models.Environment(stamp_ns=0, name="hall", belts=(belt,)))
    assert only(wrists.step(at(1.0)), "ben").orientation_xyzw != before


def pose(x: float, yaw: float = 0.0) -> models.UserPose:
    return models.UserPose(stamp_ns=1, position_m=(x, 0.0, 0.0), yaw_rad=yaw)


def progress(phase: str, purpose: str = "pose") -> models.Localization:
    return models.Localization.model_validate({"stamp_ns": 1, "phase": phase, "purpose": purpose})


def lamps(*positions: tuple[float, float, float]) -> models.Environment:
    return models.Environment(
        stamp_ns=0,
        name="room",
        lamps=tuple(models.Lamp(id=f"l{k}", position_m=p) for k, p in enumerate(positions)),
    )


def test_assumed_pose_is_newest_then_configured_then_the_rooms() -> None:
    standing = AssumedPose(Place(position_m=(1.0, 2.0, 0.0), yaw_deg=90.0))
    assert standing.at[0] == (1.0, 2.0, 0.0)
    assert standing.at[1] == pytest.approx(math.pi / 2)
    assert standing.assumed == standing.at
    standing.pose(pose(3.0))
    assert standing.assumed is None
    standing.pose(pose(4.0, 0.5))
    assert standing.at == ((4.0, 0.0, 0.0), 0.5)
    unknown = AssumedPose()
    assert unknown.assumed is None
    unknown.room(((7.0, 7.0, 0.0), 1.0))
    assert unknown.at == ((7.0, 7.0, 0.0), 1.0)


def test_anchor_is_pointed_at_as_seen_from_the_pose() -> None:
    standing = AssumedPose()
    standing.localization(progress("sampling", "anchor"))
    standing.pose(pose(2.0))
    assert standing.at[0][0] == 2.0


@pytest.mark.parametrize("reach_m", [4.0, 1.5])
def test_chosen_place_is_the_middle_of_wide_and_narrow_rooms(reach_m: float) -> None:
    room = lamps((reach_m, 0.0, 1.0), (-reach_m, 0.0, 1.0), (0.0, reach_m, 2.0), (0.0, -reach_m, 1.0))
    assert choose_pose(room)[0] == (0.0, 0.0, 0.0)
    assert middle(room) == (0.0, 0.0, 1.5)


def test_chosen_place_faces_a_belt_from_two_metres() -> None:
    room = models.Environment(
        stamp_ns=0, name="hall", belts=(models.Belt(id="b", line_m=((-3.0, 0.0, 1.0), (3.0, 0.0, 1.0))),)
    )
    (x, y, _), yaw_rad = choose_pose(room)
    assert 2.0 <= abs(y) < 2.6
    assert abs(x) < 1.0
    to_middle = math.atan2(-y, -x)
    assert yaw_rad == pytest.approx(to_middle)


def test_chosen_place_exists_in_empty_and_endless_rooms() -> None:
    floor = models.Environment(
        stamp_ns=0,
        name="floor",
        planes=(models.Plane(id="floor", center_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)),),
    )
    assert len(places(floor)) == 0
    assert choose_pose(floor) == ((0.0, 0.0, 0.0), 0.0)
    assert middle(floor)[0] > 0.0


@pytest.mark.parametrize("norm", [0.951, 1.004, 1.049])
def test_turn_is_normalized_near_norm_1_and_else_refused(norm: float) -> None:
    half = 0.5 * norm
    assert Turn(q=(half, -half, half, half), t_ms=1.0).q == pytest.approx((0.5, -0.5, 0.5, 0.5))
    with pytest.raises(ValueError, match="a quaternion of norm"):
        Turn(q=(1.2 * norm, 0.0, 0.0, 0.0), t_ms=1.0)
