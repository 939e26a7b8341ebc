"""ROS values as our messages and queries, and rejections, each with one message."""

import math
from typing import Any

import pytest

from pointit.bridges.ros2.inbound.checks import LATE_NS
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionWarning, InboundRoute
from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import NS_PER_S, AddPackage, ButtonEvent, ClockTick, SetFeeding, SetSpeed, UserPose
from pointit.schemas.topics import ADD_PACKAGE, BUTTON, CLOCK, SET_FEEDING, SET_SPEED, WRIST
from tests.unit.ros2.scenes import (
    NOW_NS,
    ROOM,
    furnished,
    into,
    jazzy,
    pose_at,
    quaternion,
    stamped,
    time_of,
    transform,
)

make = jazzy().make
LEVEL = (0.0, 0.0, math.sin(0.5), math.cos(0.5))
"""Turned by 1 rad about z."""


def arm(q: Quaternion = LEVEL, stamp_ns: int = NOW_NS) -> Any:
    name = "geometry_msgs/msg/QuaternionStamped"
    return make(name, header=stamped(stamp_ns, "metawear_ros"), quaternion=quaternion(q))


def place(*, q: Quaternion = LEVEL, at: Vec3 = (1.0, 2.0, 0.0), frame: str = "world") -> Any:
    return make("geometry_msgs/msg/PoseStamped", header=stamped(frame=frame), pose=pose_at(at, q))


def frame_of(child: str, parent: str = "world", *, q: Quaternion = LEVEL, x: float = 1.0) -> Any:
    return transform(parent, child, (x, 2.0, 0.0), q)


def tf(*frames: Any) -> Any:
    return make("tf2_msgs/msg/TFMessage", transforms=list(frames))


def taken(
    row: InboundRoute,
    value: Any,
    scene: ConversionState | None = None,
    *,
    now_ns: int = NOW_NS,
    wall_ns: int = NOW_NS,
) -> list[BusOutput | ConversionWarning]:
    """Messages from a value after its way through CDR."""
    read = jazzy().decode(row.type, jazzy().encode(row.type, value))
    found = row.convert(read, "user1", scene or furnished(), now_ns=now_ns, wall_ns=wall_ns)
    for each in found:
        if isinstance(each, BusOutput):
            assert each.at in row.into
    return list(found)


def output(found: list[BusOutput | ConversionWarning]) -> Any:
    (one,) = found
    assert isinstance(one, BusOutput), one
    return one


def said(found: list[BusOutput | ConversionWarning]) -> Any:
    return output(found).what


def warned(found: list[BusOutput | ConversionWarning]) -> str:
    (one,) = found
    assert isinstance(one, ConversionWarning), one
    assert "\n" not in one.sentence
    return one.sentence


def test_a_rotation_is_the_wrist_of_an_arm() -> None:
    row = into("rotation_in")
    one = output(taken(row, arm(stamp_ns=NOW_NS - 40)))
    assert (one.at, one.name, one.what.device) == (WRIST, "user1", "arm")
    assert one.what.stamp_ns == NOW_NS - 40
    assert one.what.orientation_xyzw == pytest.approx(LEVEL)
    assert [said(taken(row, arm())).seq for _ in range(2)] == [2, 3]
    assert said(taken(row, arm(stamp_ns=0))).stamp_ns == NOW_NS
    azimuth_rad, elevation_rad = 0.7, -0.3
    q = rotation.from_azimuth_elevation(azimuth_rad, elevation_rad)
    ahead = rotation.rotate(said(taken(row, arm(q))).orientation_xyzw, (1.0, 0.0, 0.0))
    assert math.atan2(ahead[1], ahead[0]) == pytest.approx(azimuth_rad)
    assert math.asin(ahead[2]) == pytest.approx(elevation_rad)


@pytest.mark.parametrize("norm", [0.951, 1.004, 1.049])
def test_a_rotation_whose_norm_is_nearly_1_is_normalized(norm: float) -> None:
    q = (0.5 * norm, -0.5 * norm, 0.5 * norm, 0.5 * norm)
    turned = said(taken(into("rotation_in"), arm(q))).orientation_xyzw
    assert turned == pytest.approx((0.5, -0.5, 0.5, 0.5))


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.06), (1.0, 1.0, 1.0, 1.0)])
def test_a_rotation_that_is_none_is_refused(q: Quaternion) -> None:
    assert "norm 1" in warned(taken(into("rotation_in"), arm(q)))
    assert "norm 1" in warned(taken(into("mocap_pose"), place(q=q)))


def test_an_imu_without_orientation_is_refused() -> None:
    row = into("imu_in")
    assert said(taken(row, make(row.type, header=stamped(), orientation=quaternion(LEVEL)))).seq == 1
    none = make(row.type, header=stamped(), orientation_covariance=[-1.0, *[0.0] * 8])
    assert "no orientation" in warned(taken(row, none))


@pytest.mark.parametrize(
    ("stamp_ns", "is_kept"),
    [
        *((NOW_NS + MAX_AHEAD_NS, True), (NOW_NS + MAX_AHEAD_NS + 1, False)),
        *((NOW_NS - LATE_NS, True), (NOW_NS - LATE_NS - 1, False), (12 * NS_PER_S, False)),
    ],
)
def test_a_stamp_of_another_clock_is_told_and_the_arrival_counts(stamp_ns: int, is_kept: bool) -> None:  # noqa: FBT001
    first, *others = taken(into("rotation_in"), arm(stamp_ns=stamp_ns))
    assert said([first]).stamp_ns == (stamp_ns if is_kept else NOW_NS)
    assert is_kept == (not others)
    if not is_kept:
        assert "synchronize the clocks" in warned(others)


def test_a_button_is_pressed_when_it_becomes_true() -> None:
    row, scene = into("button_in"), furnished()
    states = [False, True, True, False, True]
    found = [taken(row, make(row.type, data=state), scene) for state in states]
    assert [len(each) for each in found] == [0, 1, 0, 0, 1]
    assert found[4] == [BusOutput(BUTTON, "user1", ButtonEvent(stamp_ns=NOW_NS, seq=2, source="ros2"))]
    other = row.convert(make(row.type, data=True), "user2", scene, now_ns=NOW_NS, wall_ns=NOW_NS)
    assert len(other) == 1


def test_a_pose_of_motion_capture_is_where_the_person_stands() -> None:
    pose = said(taken(into("mocap_pose"), place(at=(1.0, 2.0, 0.25))))
    assert isinstance(pose, UserPose)
    assert (pose.position_m, pose.method) == ((1.0, 2.0, 0.25), "external")
    assert pose.yaw_rad == pytest.approx(1.0)
    assert said(taken(into("mocap_pose"), place(frame=""))).method == "external"


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (place(frame="odom"), "in the frame 'odom': send it in 'world'"),
        (place(frame="x" * 300), "in the frame 'xxx"),
        (place(at=(2e6, 0.0, 0.0)), "is not a position"),
        (place(q=(0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5))), "no heading: its x axis points 90° up"),
    ],
)
def test_a_pose_that_cannot_be_one_is_refused(value: Any, told: str) -> None:
    sentence = warned(taken(into("mocap_pose"), value))
    assert told in sentence
    assert len(sentence) < 250


def command(names: list[str], speeds: list[float]) -> Any:
    return make("conveyor_msgs/msg/BeltCommand", name=names, velocity=speeds)


def test_a_belt_command_sets_speeds() -> None:
    row = into("belt_cmd")
    assert taken(row, command(["*"], [0.5])) == [BusOutput(SET_SPEED, "", SetSpeed(speed_mps=0.5))]
    assert said(taken(row, command(["*"], [-0.5]))) == SetSpeed(speed_mps=-0.5)
    found = taken(row, command(["part_a", "*", "part_b", "part_c"], [0.25, 0.5, 0.25, 1.0]))
    assert [each.what for each in found if isinstance(each, BusOutput)] == [
        SetSpeed(speed_mps=0.5),
        SetSpeed(speed_mps=0.25, belts=("part_a", "part_b")),
    ]
    told = warned([each for each in found if isinstance(each, ConversionWarning)])
    assert "no belt 'part_c'; there are part_a, part_b" in told
    scene = furnished()
    scene.take("", ROOM.model_copy(update={"belts": ()}), NOW_NS)
    strip = said(taken(row, command(["strip_0"], [0.5]), scene))
    assert strip.belts == ("0",), "a strip that is a belt has the ROS toolkit's name"


@pytest.mark.parametrize(
    ("names", "speeds", "told"),
    [
        ([], [], "0 names and 0 velocities"),
        (["*"], [], "1 names and 0 velocities"),
        (["*"] * 300, [0.5] * 300, "at most 256"),
        (["*"], [5.5], "send one within ±5 m/s"),
        (["x" * 500], [0.5], "there is no belt 'xxx"),
    ],
)
def test_a_belt_command_that_means_nothing_is_refused(
    names: list[str], speeds: list[float], told: str
) -> None:
    sentence = warned(taken(into("belt_cmd"), command(names, speeds)))
    assert told in sentence
    assert len(sentence) < 250


def test_a_package_is_added_by_the_number_of_its_kind_and_feeders_rest_as_told() -> None:
    row = into("add_package")
    assert taken(row, make(row.type, data=1)) == [BusOutput(ADD_PACKAGE, "", AddPackage(kind="red"))]
    told = warned(taken(row, make(row.type, data=77)))
    assert "kind 77 means nothing here: there are 0 blue, 1 red" in told
    row, scene = into("feed"), furnished()
    for is_on in (False, False, True, True):
        found = taken(row, make(row.type, data=is_on), scene)
        assert found == [BusOutput(SET_FEEDING, "", SetFeeding(feeding=is_on))]


def clock(sim_s: float) -> Any:
    return make("rosgraph_msgs/msg/Clock", clock=time_of(round(sim_s * NS_PER_S)))


def ticks(row: InboundRoute, times: list[tuple[float, float]]) -> list[ClockTick]:
    """Ticks from pairs of wall time and simulated time, s."""
    found: list[ClockTick] = []
    for wall_s, sim_s in times:
        for each in taken(row, clock(sim_s), wall_ns=NOW_NS + round(wall_s * NS_PER_S)):
            assert output([each]).at is CLOCK
            found.append(said([each]))
    return found


def test_simulated_time_is_told_once_a_second_with_its_speed() -> None:
    row = into("clock_in")
    assert not row.enabled
    found = ticks(row, [(0.01 * n, 100.0 + 0.02 * n) for n in range(301)])
    assert [tick.speed for tick in found] == pytest.approx([1.0, 2.0, 2.0, 2.0])
    assert [(tick.stamp_ns - NOW_NS) / NS_PER_S for tick in found] == pytest.approx([0.0, 0.25, 1.25, 2.25])
    assert [tick.sim_ns / NS_PER_S for tick in found] == pytest.approx([100.0, 100.5, 102.5, 104.5])


@pytest.mark.parametrize("jump_s", [-50.0, 50.0])
def test_a_jump_of_simulated_time_is_told_at_once(jump_s: float) -> None:
    row = into("clock_in")
    steady = [(0.1 * n, 100.0 + 0.1 * n) for n in range(5)]
    found = ticks(row, [*steady, (0.5, 100.5 + jump_s)])
    assert [tick.sim_ns / NS_PER_S for tick in found] == pytest.approx([100.0, 100.3, 100.5 + jump_s])
    assert found[-1].speed == pytest.approx(1.0)


def test_a_wall_clock_that_was_set_back_is_told_at_once_and_one_that_stands_still_creeps() -> None:
    found = ticks(into("clock_in"), [(0.0, 100.0), (0.1, 100.1), (-50.0, 100.2)])
    assert [(tick.stamp_ns - NOW_NS) // NS_PER_S for tick in found] == [0, -50]
    found = ticks(into("clock_in"), [(0.5 * n, 100.0) for n in range(8)])
    assert found[-1].speed == pytest.approx(0.01)
    assert "before 0" in warned(taken(into("clock_in"), clock(-1.0)))
