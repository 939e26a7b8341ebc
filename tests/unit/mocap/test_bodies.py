"""Bodies of a stream as objects and as people: coordinates, and bodies that are not used."""

import math

import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from pointit.bridges.mocap.bodies import Bodies, BodyPose, BodySample, TimedFrame
from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.people import WornBodies
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, ImuSample, TrackedObject, UserPose
from pointit.schemas.environment import Frame
from pointit.schemas.system import Figure
from tests.support.bench import START_NS

STEP_NS = NS_PER_S // 100
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def body(
    x: float, y: float = 0.0, z: float = 0.0, *, is_tracked: bool = True, measured: int | None = None
) -> BodySample:
    return BodySample(1, (x, y, z), UPRIGHT, 0.0004, is_tracked, measured)


class Stream:
    """Bodies, fed at 100 Hz."""

    def __init__(self, frame: Frame | None = None, **parameters: object) -> None:
        self.bodies = Bodies(MocapConfig.model_validate({"server": "motive", "up": "z", **parameters}))
        self.frame = frame
        self.now_ns = START_NS

    def put(self, *named: tuple[str, BodySample], times: int = 1) -> set[str]:
        used: set[str] = set()
        for _ in range(times):
            self.now_ns += STEP_NS
            used |= {
                pose.name for pose in self.bodies.update(TimedFrame(self.now_ns, 0.0, named), self.frame)
            }
        return used

    @property
    def objects(self) -> dict[str, TrackedObject]:
        return {each.id: each for each in self.bodies.objects(self.now_ns)}

    def place(self, name: str) -> Vec3:
        return self.objects[name].position_m

    @property
    def problem(self) -> str:
        return self.bodies.problem(self.now_ns)


def test_y_axis_of_motive_is_up_unless_configured() -> None:
    stream = Stream(up="y", bodies={"cart": {"kind": "robot"}})
    turn = (0.0, math.sin(0.4), 0.0, math.cos(0.4))
    stream.put(("cart", BodySample(1, (1.0, 2.0, 3.0), turn, 0.0004, is_tracked=True, measured=None)))
    assert stream.place("cart") == (1.0, -3.0, 2.0)
    assert stream.objects["cart"].yaw_rad == pytest.approx(0.8)
    stream = Stream()
    stream.put(("cup", body(1.0, 2.0, 3.0)))
    assert stream.place("cup") == (1.0, 2.0, 3.0)


def test_a_frame_of_the_map_turns_and_moves_bodies() -> None:
    turned = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))
    stream = Stream(
        Frame(id="motive", position_m=(10.0, 0.0, 0.0), orientation_xyzw=turned),
        bodies={"cart": {"kind": "robot"}},
    )
    stream.put(("cart", body(1.0, 2.0, 0.5)))
    assert stream.place("cart") == pytest.approx((8.0, 1.0, 0.5))
    assert stream.objects["cart"].yaw_rad == pytest.approx(math.pi / 2)


def test_objects_have_kind_speed_and_at_least_a_millimetre_uncertainty() -> None:
    stream = Stream(bodies={"cup": {"kind": "red", "length_m": 0.2}})
    for index in range(30):
        stream.put(("cup", body(0.01 * index)), ("box", body(5.0)))
    cup = stream.objects["cup"]
    box = stream.objects["box"]
    assert (cup.kind, cup.length_m, cup.position_sigma_m) == ("red", 0.2, 0.001)
    assert cup.velocity_mps == pytest.approx((1.0, 0.0, 0.0))
    assert (box.kind, box.velocity_mps, box.yaw_rad) == ("object", (0.0, 0.0, 0.0), None)


@pytest.mark.parametrize(
    ("hidden", "sentence"),
    [
        (body(9.0, is_tracked=False), "cup is not seen"),
        (body(9.0, measured=2), "cup has 2 markers that cameras see"),
    ],
)
def test_unseen_and_model_filled_bodies_leave_and_are_reported(hidden: BodySample, sentence: str) -> None:
    stream = Stream(bodies={"cup": {}})
    stream.put(("cup", body(1.0, measured=3)), times=2)
    assert not stream.put(("cup", hidden), times=10)
    assert stream.place("cup") == (1.0, 0.0, 0.0), "for a moment it is where it was"
    stream.put(("cup", hidden), times=20)
    assert stream.objects == {}
    assert stream.problem == ""
    stream.put(("cup", hidden), times=200)
    assert sentence in stream.problem
    assert stream.bodies.states() == {"cup": False}


def test_bodies_that_exchange_names_are_not_used_and_reported() -> None:
    stream = Stream()
    stream.put(("cup", body(1.0)), ("plate", body(1.75)), times=5)
    assert not stream.put(("cup", body(1.75)), ("plate", body(1.0)), times=50)
    assert "cup is where plate was" in stream.problem
    assert "(1 more)" in stream.problem
    assert stream.put(("cup", body(1.0)), ("plate", body(1.75))) == {"cup", "plate"}


def test_a_jump_is_used_after_it_stayed_for_a_moment() -> None:
    stream = Stream()
    stream.put(("cup", body(1.0)), times=5)
    assert not stream.put(("cup", body(3.0)), times=30)
    assert "cup jumped by 2.00 m" in stream.problem
    assert stream.put(("cup", body(3.0)), times=2) == {"cup"}
    assert stream.objects["cup"].velocity_mps == (0.0, 0.0, 0.0)


def test_fast_and_reappearing_bodies_have_not_jumped() -> None:
    stream = Stream()
    for index in range(100):
        assert stream.put(("cup", body(0.05 * index))) == {"cup"}, "5 m/s"
    stream.now_ns += NS_PER_S
    assert stream.put(("cup", body(9.0))) == {"cup"}


def test_bodies_of_one_name_are_not_used_and_reported() -> None:
    stream = Stream()
    assert not stream.put(("cup", body(1.0)), ("cup", body(2.0)), times=300)
    assert "two bodies are called 'cup'" in stream.problem


def test_renamed_or_removed_body_is_reported_as_missing() -> None:
    stream = Stream(bodies={"cap": {"person": "anna"}, "cup": {}})
    assert stream.problem == "", "nothing is streamed yet"
    stream.put(("cap", body(1.0, z=1.7)), ("cup", body(2.0)), times=100)
    assert stream.problem == ""
    stream.put(("Kappe", body(1.0, z=1.7)), ("cup 1", body(2.0)), times=250)
    assert stream.problem == (
        "Motive streams no body 'cap': it has Kappe, cup 1; correct `bodies`, or rename it there (1 more)"
    )
    stream.put(("cap", body(1.0, z=1.7)), times=250)
    assert stream.problem.startswith("Motive streams no body 'cup': did you mean cap?")


def test_stream_is_refused_when_a_head_is_implausible() -> None:
    """As of a Motive that streams z up, read as y up: the cap of a person at (1, -1.5)."""
    room = (("cup", body(0.5, 1.0, 0.8)), ("cap", body(1.0, -1.5, 1.7)))
    stream = Stream(up="y", bodies={"cap": {"person": "anna"}, "cup": {"kind": "red"}})
    assert not stream.put(*room, times=100)
    assert stream.objects == {}
    assert stream.problem == (
        "cap is -1.50 m above the floor, 0.8 to 2.3 m are accepted at first: correct `up`, `unit`, `frame` "
        "or `bodies`"
    )
    assert Stream(bodies={"cap": {"person": "anna"}}).put(*room) == {"cup", "cap"}


def test_stream_stays_in_use_when_a_person_sits() -> None:
    stream = Stream(bodies={"cap": {"person": "anna"}, "hat": {"person": "ben"}})
    for tick in range(200):
        used = stream.put(("cap", body(1.0, z=1.7 - 0.006 * tick)), ("cup", body(3.0)))
        assert used == {"cap", "cup"}
    used = stream.put(("cap", body(1.0, z=0.5)), ("hat", body(2.0, z=0.6)), ("cup", body(3.0)))
    assert used == {"cap", "cup"}
    assert "hat is 0.60 m above the floor" in stream.problem
    assert "hat" in stream.put(("hat", body(2.0, z=0.9)))


def test_stream_is_refused_again_when_its_axes_change() -> None:
    stream = Stream(bodies={"cap": {"person": "anna"}})
    stream.put(("cap", body(1.0, -1.5, 1.7)), ("cup", body(0.5, 1.0, 0.8)), times=50)
    assert not stream.put(("cap", body(1.0, 1.7, -1.5)), ("cup", body(0.5, 0.8, 1.0)), times=1200)
    assert "cap is -1.50 m above the floor" in stream.problem


@pytest.mark.parametrize(("unit", "is_used"), [("m", False), ("mm", True)])
def test_millimetres_are_refused_unless_declared(unit: str, *, is_used: bool) -> None:
    stream = Stream(unit=unit)
    assert bool(stream.put(("cup", body(1000.0, 1500.0, 800.0)), times=2)) is is_used
    if is_used:
        assert stream.place("cup") == pytest.approx((1.0, 1.5, 0.8))
    else:
        assert "cup is 1972 m from the cameras' origin, limit 100 m: correct `unit`" in stream.problem
    with pytest.raises(ValidationError, match="QTM streams millimetres by its protocol"):
        MocapConfig(system="qtm", unit="mm")


def test_body_in_place_of_a_departed_one_is_no_exchange() -> None:
    stream = Stream()
    stream.put(("cup", body(1.0)), ("plate", body(3.0)), times=50)
    stream.put(("cup", body(1.0)), times=500)
    stream.put(("cup", body(3.0)), times=2)
    assert "cup jumped by 2.00 m" in stream.problem


@pytest.mark.parametrize(
    ("bodies", "sentence"),
    [
        ({"a": {"person": "anna"}, "b": {"person": "anna"}}, "two are the head of anna"),
        ({"a": {"person": "anna", "part": "forearm"}}, "anna has no `part: head`"),
    ],
)
def test_people_have_one_head_each(bodies: object, sentence: str) -> None:
    with pytest.raises(ValidationError, match=sentence):
        MocapConfig.model_validate({"server": "motive", "bodies": bodies})


def test_figures_of_the_longest_name_are_accepted_by_health() -> None:
    person = "p" * 64
    bodies = {"cuff": {"person": person, "part": "forearm"}, "cap": {"person": person}}
    config = MocapConfig.model_validate({"server": "127.0.0.1", "truth": True, "bodies": bodies})
    figures = WornBodies(config).figures(START_NS)
    assert len(figures) == 3
    assert [Figure(name=name, value=1.0, unit=unit).name for name, (_, unit) in figures.items()] == [*figures]


def test_truth_gives_the_error_of_the_current_pose() -> None:
    bodies = {"cap": {"person": "anna"}}
    config = MocapConfig.model_validate({"server": "127.0.0.1", "truth": True, "bodies": bodies})
    worn = WornBodies(config)
    worn.on_pose(
        "anna", UserPose(stamp_ns=START_NS, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0, method="static_targets")
    )
    errors_m: list[float | None] = []
    for second, x in ((0, 1.25), (1, 2.0)):
        now_ns = START_NS + second * NS_PER_S
        worn.on_body(BodyPose("cap", now_ns, (x, 2.0, 1.75), (0.0, 0.0, 0.0, 1.0), 0.001))
        errors_m.append(worn.figures(now_ns)["position error of anna"][0])

    assert errors_m == pytest.approx([0.25, 1.0])
    assert [each.id for each in worn.objects(now_ns, now_ns)] == ["anna"]
    assert worn.objects(now_ns, now_ns + NS_PER_S // 5) == [], "newer frames do not have the cap"

    later_ns = START_NS + 10 * NS_PER_S  # nobody is seen any more
    assert worn.figures(later_ns)["position error of anna"][0] is None
    assert worn.figures(later_ns)["yaw error of anna"][0] is None


@pytest.mark.parametrize("is_truth", [False, True])
def test_pose_and_truth_end_when_the_yaw_jumps(*, is_truth: bool) -> None:
    bodies = {"cap": {"person": "anna"}, "cuff": {"person": "anna", "part": "forearm"}}
    config = MocapConfig.model_validate({"server": "127.0.0.1", "truth": is_truth, "bodies": bodies})
    worn = WornBodies(config)
    mount = Rotation.from_euler("xyz", (0.4, -0.8, 1.2))
    poses: list[tuple[float, UserPose]] = []
    kinds: list[tuple[float, str]] = []
    for tick in range(500):
        time_s = tick / 50
        now_ns = START_NS + tick * NS_PER_S // 50
        yaw_rad = 0.9 if time_s < 8 else -0.3
        angles = (math.sin(1.7 * time_s), 0.5 * math.sin(2.3 * time_s + 0.4), 0.3 * math.sin(time_s))
        arm = Rotation.from_euler("ZYX", angles)
        x, y, z, w = (arm * mount).as_quat()
        worn.on_body(BodyPose("cap", now_ns, (1.0, 2.0, 1.7), (0.0, 0.0, 0.0, 1.0), 0.001))
        worn.on_body(BodyPose("cuff", now_ns, (1.4, 2.0, 1.2), (x, y, z, w), 0.001))
        x, y, z, w = (Rotation.from_euler("z", -yaw_rad) * arm).as_quat()
        worn.on_imu("anna", ImuSample(stamp_ns=now_ns, orientation_xyzw=(x, y, z, w)))
        poses += [(time_s, pose) for _, pose in worn.poses(now_ns)]
        kinds += [(time_s, each.kind) for each in worn.objects(now_ns, now_ns)]

    if is_truth:
        assert poses == []
        assert {kind for time_s, kind in kinds if 6 < time_s < 8} == {"person_frame"}
        assert {kind for time_s, kind in kinds if time_s > 9} == {"person"}
    else:
        lost_s, last = poses[-1]
        assert 8 < lost_s < 9
        assert last.yaw_rad == pytest.approx(0.9, abs=0.05)
        assert math.sqrt(last.covariance[8]) > math.radians(90.0)
        assert math.sqrt(poses[-2][1].covariance[8]) < math.radians(65.0)
    assert "turned by 69° against each other" in worn.problem(now_ns)
