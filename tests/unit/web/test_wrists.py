"""Wrists of pages and headsets, cues of phones, pairing."""

import math
import xml.etree.ElementTree as ET
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

import pointit.schemas as models
from pointit.bridges.web.config import Place, WebConfig
from pointit.bridges.web.wire import HeadsetMotion, Received, SpaceAlignment
from pointit.bridges.web.wrists.pairing import UNUSED_S, Pairing, offer
from pointit.bridges.web.wrists.phone import STEPS, PhoneCues
from pointit.bridges.web.wrists.wrist_control import FASTEST_RADPS, MouseArm, WristControl
from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas import NS_PER_S, Announced, Candidate, Feedback, Interaction, Localization
from pointit.services.pointing.pointer import ArmRay
from tests.support import there

STEP_NS = NS_PER_S // 60
SAMPLING: dict[str, Any] = {"stamp_ns": 0, "phase": "sampling"}
coordinates = st.floats(-20.0, 20.0)


def angle_between(a: Quaternion, b: Quaternion) -> float:
    x, y, z, w = rotation.multiply(rotation.inverse(a), b)
    return 2.0 * math.atan2(math.hypot(x, y, z), abs(w))


def test_mouse_arm_points_ahead_before_its_first_aim() -> None:
    arm = rotation.rotate(MouseArm().step(0), (1.0, 0.0, 0.0))
    assert vector.azimuth(arm) == pytest.approx(0.0)
    assert -0.5 < vector.elevation(arm) < 0.0


@given(st.lists(st.tuples(coordinates, coordinates, st.floats(0.0, 3.0)), min_size=2, max_size=12))
def test_mouse_arm_never_turns_faster_than_a_wrist(places: list[Vec3]) -> None:
    arm = MouseArm()
    arm.set_pose((0.3, 0.2, 0.0), 0.7)
    before = arm.step(0)
    now_ns = 0
    for place in places:
        arm.aim(place)
        for _ in range(3):
            now_ns += STEP_NS
            after = arm.step(now_ns)
            assert angle_between(before, after) <= FASTEST_RADPS * STEP_NS / NS_PER_S + 1e-6
            before = after


def test_mouse_arm_follows_a_jump_within_half_a_second() -> None:
    arm = MouseArm()
    now_ns = 0
    arm.aim((3.0, 0.0, 1.0))
    arm.step(now_ns)
    arm.aim((-3.0, 0.5, 1.0))
    steps = [arm.step(now_ns := now_ns + STEP_NS) for _ in range(30)]
    assert angle_between(steps[0], steps[-1]) > 2.0
    assert steps[-1] == steps[-2]


def test_mouse_arm_takes_the_shorter_way_round() -> None:
    arm = MouseArm()
    arm.aim((-3.0, 0.5, 1.0))
    arm.step(0)
    arm.aim((-3.0, -0.5, 1.0))  # 19° further, across the azimuth where angles begin again
    steps = [arm.step(k * STEP_NS) for k in range(1, 5)]
    assert steps[1] == steps[3]


def test_tremor_has_its_rms_and_repeats_with_its_seed() -> None:
    def angles_of(seed: int) -> list[float]:
        arm = MouseArm(seed=seed)
        arm.aim((3.0, 0.0, 1.6))
        still = arm.step(0)
        arm.set_tremor(math.radians(0.5))
        return [angle_between(still, arm.step(k * STEP_NS)) for k in range(1, 1200)]

    first = angles_of(1)
    rms_deg = math.degrees(math.sqrt(sum(a * a for a in first) / len(first)))
    assert rms_deg == pytest.approx(0.5 * math.sqrt(2.0), rel=0.1)  # about two axes
    assert first == angles_of(1)
    assert first != angles_of(2)


def test_interaction_state_is_sent_once_and_stays_in_cues() -> None:
    cues = PhoneCues()
    sure = Interaction(stamp_ns=0, state="pointing", next_step="hold on a package")
    for state in (sure, sure.model_copy(update={"is_unsure": True})):
        cue = there(cues.interaction(state))
        assert (cue.state, cue.next_step) == ("pointing", "hold on a package")
        assert cue.wants_double == state.is_unsure
        assert cues.interaction(state) is None
        assert cues.current == cue
    feedback = there(cues.feedback(Feedback(stamp_ns=0, cue="selected")))
    assert (feedback.state, feedback.wants_double) == ("pointing", True)


def test_names_are_cues_and_phones_know_that_there_are_some() -> None:
    cues = PhoneCues()
    assert not cues.current.has_names
    first = there(cues.feedback(Announced(stamp_ns=1)))
    assert first.has_names
    assert first.announced == ""
    assert cues.current == first
    assert cues.feedback(Announced(stamp_ns=2)) is None
    spoken = cues.feedback(Announced(stamp_ns=3, object_id="d", label="Kettle", began_ns=3))
    assert spoken == first.model_copy(update={"announced": "Kettle"})
    assert cues.current == first


def test_localization_cues_name_each_target_once_and_refusals() -> None:
    def at(samples: int, index: int) -> Localization:
        target = {"target_id": f"led_{index}", "target_index": index, "target_count": 3}
        return Localization.model_validate({**SAMPLING, **target, "samples": samples})

    cues = PhoneCues()
    assert there(cues.localization(at(0, 0))).text == "point at led_0, 1 of 3"
    assert cues.localization(at(5, 0)) is None
    assert there(cues.localization(at(5, 1))).text == "point at led_1, 2 of 3"
    refused = there(cues.localization(Localization(stamp_ns=0, phase="refused", reason="hold more steadily")))
    assert refused.text == "hold more steadily"
    assert cues.localization(Localization(stamp_ns=0, phase="idle")) is None


def test_progress_is_sent_in_steps_until_the_end() -> None:
    def at(progress: float, **fields: Any) -> Localization:
        fields = {"phase": "sampling", "target_id": "led_0", "progress": progress, **fields}
        return Localization.model_validate({"stamp_ns": 0, **fields})

    cues = PhoneCues()
    told = [cues.localization(at(k / 1000.0)) for k in range(1001)]
    shares = [cue.progress for cue in told if cue is not None]
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert len(shares) == STEPS + 1
    assert [cue.text for cue in told if cue is not None and cue.text] == ["point at led_0"]
    ended = there(cues.localization(at(1.0, phase="solved")))
    assert ended.progress is None
    assert ended.text == ""
    assert cues.localization(at(0.0, target_id="", ahead=("ben",))) is None  # who waits points at nothing
    assert cues.current.progress is None


def test_number_of_robots_is_no_target_count() -> None:
    cues = PhoneCues()
    candidates = tuple(
        Candidate(object_id=name, probability=share) for name, share in (("r1", 0.6), ("r2", 0.4))
    )
    meant = {"target_id": "r1", "target_count": 3, "candidates": candidates}
    assert there(cues.localization(Localization.model_validate({**SAMPLING, **meant}))).text == "point at r1"


def test_token_pairs_a_phone_with_one_person() -> None:
    pairing = Pairing()
    token, replaced = pairing.pair("anna", 0.0)
    assert replaced == ""
    secret = there(pairing.redeem(token, 1.0))
    assert secret != token
    phone = there(pairing.phone(secret))
    assert (phone.user, phone.page) == ("anna", pairing.paired("anna", 1.0))
    assert pairing.phone(token) is None
    assert pairing.phone("") is None
    assert pairing.redeem("other", 1.0) is None
    assert pairing.redeem("", 1.0) is None
    assert pairing.phone(there(pairing.redeem(token, 2.0))) is phone
    assert pairing.phone(secret) is None


def test_unused_token_expires_and_a_paired_phone_stays() -> None:
    pairing = Pairing()
    unused, _ = pairing.pair("anna", 0.0)
    used, _ = pairing.pair("ben", 0.0)
    secret = pairing.redeem(used, 1.0)
    late_s = UNUSED_S + 1.0
    assert pairing.paired("anna", UNUSED_S - 1.0) != ""
    assert pairing.redeem(unused, late_s) is None
    assert pairing.paired("anna", late_s) == ""
    assert secret is not None
    assert pairing.phone(secret) is not None
    assert pairing.paired("ben", late_s) != ""
    assert pairing.redeem(used, late_s) is None


def test_pairing_again_and_unpairing_revoke_the_phone() -> None:
    pairing = Pairing()
    token, _ = pairing.pair("anna", 0.0)
    secret = there(pairing.redeem(token, 1.0))
    page = pairing.paired("anna", 1.0)
    newer, replaced = pairing.pair("anna", 2.0)
    assert replaced == page
    assert pairing.phone(secret) is None
    assert pairing.redeem(token, 3.0) is None
    other = there(pairing.redeem(newer, 3.0))
    assert pairing.unpair("anna") not in ("", page)
    assert pairing.phone(other) is None
    assert pairing.paired("anna", 3.0) == ""
    assert pairing.unpair("anna") == ""


def test_offer_has_a_qr_code_without_inline_styles() -> None:
    reply = offer("https://192.168.1.20:8443/phone?token=abc", "AB:CD")
    assert (reply["url"], reply["fingerprint"]) == ("https://192.168.1.20:8443/phone?token=abc", "AB:CD")
    assert reply["expires_s"] == UNUSED_S
    drawn = ET.fromstring(reply["qr_svg"])  # noqa: S314 - our own
    assert drawn.tag == "{http://www.w3.org/2000/svg}svg"
    assert all("style" not in node.attrib for node in drawn.iter())
    assert len(reply["qr_svg"]) < 16_000


START = 1_700_000_000 * models.NS_PER_S
ROOM = SpaceAlignment(yaw_rad=2.1, origin_m=(1.5, -0.7, 0.04))
EYES_M: Vec3 = (0.4, -0.9, 1.52)
"""Eyes in {W}, 12 cm lower than by the measures of the profile."""
RECEIVED: TypeAdapter[Any] = TypeAdapter(Received)


def at(seconds: float) -> int:
    return START + round(seconds * models.NS_PER_S)


def in_session(at_m: Vec3) -> Vec3:
    """Return a point of {W} in the space of the session, z up."""
    return vector.rotate_z(vector.subtract(at_m, ROOM.origin_m), -ROOM.yaw_rad)


def motion(eyes_m: Vec3 = EYES_M, tip_m: Vec3 | None = None, *, user: str = "anna") -> HeadsetMotion:
    tip = None if tip_m is None else in_session(tip_m)
    return HeadsetMotion(user=user, alignment=ROOM, eyes_m=in_session(eyes_m), tip_m=tip)


def towards(target_m: Vec3, reach_m: float = 0.5, eyes_m: Vec3 = EYES_M) -> Vec3:
    """Return the tip of a hand on the line from the eyes to `target_m`."""
    line = vector.normalized(vector.subtract(target_m, eyes_m))
    return vector.add(eyes_m, vector.scale(line, reach_m))


@pytest.fixture
def wrists() -> WristControl:
    wrists = WristControl(WebConfig(places={"anna": Place(position_m=(1.0, 0.0, 0.0), yaw_deg=30.0)}))
    wrists.acquire("anna", "page1", "headset")
    return wrists


def wear(
    wrists: WristControl, part: HeadsetMotion, now_ns: int = START
) -> tuple[models.UserPose, models.WristSample]:
    measured = there(wrists.move_by_headset("page1", part, now_ns))
    assert measured[0] is not None
    return measured[0], measured[1]


def error_rad(
    pose: models.UserPose, sample: models.WristSample, profile: models.UserProfile, at_m: Vec3
) -> float:
    """Return the angle between the person's ray and the line from its origin to `at_m`."""
    ray = there(ArmRay.from_profile(profile).ray(sample.orientation_xyzw))
    origin_m, direction = (vector.rotate_z(each, pose.yaw_rad) for each in ray)
    return vector.angle_between(direction, vector.subtract(at_m, vector.add(pose.position_m, origin_m)))


@pytest.mark.parametrize("hand", ["left", "right"])
@pytest.mark.parametrize("reach_m", [0.3, 0.6])
def test_headset_ray_goes_from_eyes_over_tip_for_any_body(
    wrists: WristControl, hand: Literal["left", "right"], reach_m: float
) -> None:
    body = models.BodyMeasures(footprint_to_neck_m=1.1, neck_to_shoulder_m=0.2, shoulder_to_wrist_m=0.7)
    profile = models.UserProfile(stamp_ns=0, body=body, hand=hand)
    wrists.profile("anna", profile)
    for number, target_m in enumerate([(4.0, 2.0, 1.0), (-3.0, 0.4, 2.5), (0.4, -4.0, 0.3)]):
        pose, sample = wear(wrists, motion(tip_m=towards(target_m, reach_m)), at(10.0 * number))
        assert error_rad(pose, sample, profile, target_m) < 1e-6
        assert (pose.method, sample.device, sample.source) == ("external", "arm", "headset")
        assert pose.yaw_rad == pytest.approx(math.radians(30.0))  # who takes over later has the same {H}


@pytest.mark.parametrize("ray_model", ["shoulder_arm", "forearm"])
def test_arm_rays_meet_the_line_of_sight_at_3_m(
    wrists: WristControl, ray_model: Literal["shoulder_arm", "forearm"]
) -> None:
    profile = models.UserProfile(stamp_ns=0, ray_model=ray_model)
    wrists.profile("anna", profile)
    pose, sample = wear(wrists, motion(tip_m=towards((4.0, 2.0, 1.0))))
    assert error_rad(pose, sample, profile, towards((4.0, 2.0, 1.0), 3.0)) < 1e-6


@pytest.mark.parametrize("tip_m", [None, towards((4.0, 2.0, 1.0), 0.02), towards((4.0, 2.0, 1.0), 2.0)])
def test_arm_hangs_while_no_hand_points(wrists: WristControl, tip_m: Vec3 | None) -> None:
    wear(wrists, motion(tip_m=towards((4.0, 2.0, 1.0))))
    pose, sample = wear(wrists, motion(tip_m=tip_m), at(2.0))
    assert vector.elevation(there(ArmRay().ray(sample.orientation_xyzw))[1]) < math.radians(-80.0)
    assert math.dist(pose.position_m[:2], EYES_M[:2]) < 1e-6


def test_headset_sends_few_poses_and_many_samples(wrists: WristControl) -> None:
    measured = [
        wrists.move_by_headset("page1", motion(tip_m=towards((4.0, 2.0, 1.0))), at(k / 60.0))
        for k in range(120)
    ]
    assert [each is not None for each in measured] == [True] * 120
    assert sum(each is not None and each[0] is not None for each in measured) == 4
    steps = [motion((EYES_M[0] + 0.02 * k, *EYES_M[1:])) for k in range(1, 61)]
    moved = [wrists.move_by_headset("page1", step, at(3.0 + k / 60.0)) for k, step in enumerate(steps)]
    assert sum(each is not None and each[0] is not None for each in moved) == 10


def test_headset_poses_go_on_when_the_clock_is_set_back(wrists: WristControl) -> None:
    wear(wrists, motion(), at(60.0))
    pose, _ = wear(wrists, motion((EYES_M[0] + 1.0, *EYES_M[1:])), at(0.0))
    assert pose.position_m[0] == pytest.approx(EYES_M[0] + 1.0)


def test_silent_phone_is_released_when_time_begins_at_0() -> None:
    wrists = WristControl(WebConfig())
    wrists.acquire("anna", "phone1", "phone")
    assert wrists.step(models.NS_PER_S // 2) == []
    assert wrists.holder("anna") == ("", "own")


def test_headset_moves_nothing_when_not_aligned_or_far_away(wrists: WristControl) -> None:
    with pytest.raises(RefusedError, match="touch three lamps or things first"):
        wrists.move_by_headset("page1", HeadsetMotion(user="anna", eyes_m=(0.0, 0.0, 1.6)), START)
    far = HeadsetMotion(user="anna", alignment=ROOM, eyes_m=(9e5, 0.0, 1.6))
    with pytest.raises(RefusedError, match="limit 1000 m: align it again"):
        wrists.move_by_headset("page1", far, START)


number = st.floats(allow_nan=True, allow_infinity=True) | st.integers() | st.none() | st.text(max_size=3)
point = st.lists(number, min_size=2, max_size=4) | st.none()


@given(eyes_m=point, tip_m=point, yaw_rad=number, origin_m=point, user=st.sampled_from(["anna", "*", ""]))
def test_malformed_headset_values_raise_only_refusals(
    eyes_m: object, tip_m: object, yaw_rad: object, origin_m: object, user: object
) -> None:
    wrists = WristControl(WebConfig())
    wrists.acquire("anna", "page1", "headset")
    space = {"yaw_rad": yaw_rad, "origin_m": origin_m}
    try:
        part = RECEIVED.validate_python(
            {"kind": "headset", "user": user, "eyes_m": eyes_m, "tip_m": tip_m, "alignment": space}
        )
        wrists.move_by_headset("page1", part, START)
    except (ValidationError, RefusedError):
        return


def test_resting_headset_repeats_its_sample_and_silence_releases_it(
    wrists: WristControl,
) -> None:
    assert wrists.step(START) == []  # it was taken just now, and has sent nothing yet
    assert wrists.holder("anna") == ("page1", "headset")
    _, sample = wear(wrists, motion(tip_m=towards((4.0, 2.0, 1.0))), at(0.5))
    ((user, again),) = wrists.step(at(0.8))
    assert (user, again.source, again.orientation_xyzw) == ("anna", "headset", sample.orientation_xyzw)
    ((_, _),), ((_, hanging),) = wrists.step(at(1.6)), wrists.step(at(4.0))
    assert rotation.rotate(hanging.orientation_xyzw, (1.0, 0.0, 0.0))[2] < -0.99
    assert wrists.holder("anna") == ("page1", "headset")
    assert wrists.step(at(5.6)) == []
    assert wrists.holder("anna") == ("", "own")
    assert wrists.move_by_headset("page1", motion(), at(5.7)) is None


def test_headset_has_no_tremor_of_the_mouse() -> None:
    wrists = WristControl(WebConfig())
    wrists.acquire("anna", "page0", "mouse")
    wrists.set_tremor("anna", "page0", 3.0)
    wrists.acquire("anna", "page1", "headset")
    measured = [wear(wrists, motion(tip_m=towards((4.0, 2.0, 1.0))), at(k)) for k in range(3)]
    assert len({sample.orientation_xyzw for _, sample in measured}) == 1
