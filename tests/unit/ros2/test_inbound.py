"""ROS values as our messages and queries, and rejections, each with one message."""

import math
from typing import Any

import pytest

from pointit.bridges.ros2.inbound.checks import LATE_NS
from pointit.bridges.ros2.inbound.person import MAX_TF_AGE_NS, MAX_TRANSFORMS, SOONEST_NS, Poses
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import (
    BusOutput,
    ConversionContext,
    ConversionWarning,
    InboundRoute,
)
from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import (
    NS_PER_S,
    AddPackage,
    ButtonEvent,
    ClockTick,
    ImuSample,
    SetFeeding,
    SetSpeed,
    UserPose,
)
from pointit.schemas.topics import ADD_PACKAGE, BUTTON, CLOCK, POSE, SET_FEEDING, SET_POSE, SET_SPEED, WRIST
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
    assert said(taken(row, arm(stamp_ns=0))).stamp_ns == NOW_NS
    azimuth_rad = 0.7
    elevation_rad = -0.3
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


@pytest.mark.parametrize(
    ("stamp_ns", "is_kept"),
    [
        *((NOW_NS + MAX_AHEAD_NS, True), (NOW_NS + MAX_AHEAD_NS + 1, False)),
        *((NOW_NS - LATE_NS, True), (NOW_NS - LATE_NS - 1, False), (12 * NS_PER_S, False)),
    ],
)
def test_stamp_of_another_clock_is_reported_and_replaced(stamp_ns: int, is_kept: bool) -> None:
    first, *others = taken(into("rotation_in"), arm(stamp_ns=stamp_ns))
    assert said([first]).stamp_ns == (stamp_ns if is_kept else NOW_NS)
    assert is_kept == (not others)
    if not is_kept:
        assert "synchronize the clocks" in warned(others)


def test_a_button_is_pressed_when_it_becomes_true() -> None:
    row = into("button_in")
    scene = furnished()
    states = [False, True, True, False, True]
    found = [taken(row, make(row.type, data=state), scene) for state in states]
    assert [len(each) for each in found] == [0, 1, 0, 0, 1]
    assert found[4] == [BusOutput(BUTTON, "user1", ButtonEvent(stamp_ns=NOW_NS, source="ros2"))]
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


def test_package_is_added_by_kind_number_and_feeding_is_set() -> None:
    row = into("add_package")
    assert taken(row, make(row.type, data=1)) == [BusOutput(ADD_PACKAGE, "", AddPackage(kind="red"))]
    told = warned(taken(row, make(row.type, data=77)))
    assert "kind 77 means nothing here: there are 0 blue, 1 red" in told
    row = into("feed")
    scene = furnished()
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


def test_simulated_time_is_published_once_a_second_with_its_speed() -> None:
    row = into("clock_in")
    assert not row.enabled
    found = ticks(row, [(0.01 * n, 100.0 + 0.02 * n) for n in range(301)])
    assert [tick.speed for tick in found] == pytest.approx([1.0, 2.0, 2.0, 2.0])
    assert [(tick.stamp_ns - NOW_NS) / NS_PER_S for tick in found] == pytest.approx([0.0, 0.25, 1.25, 2.25])
    assert [tick.sim_ns / NS_PER_S for tick in found] == pytest.approx([100.0, 100.5, 102.5, 104.5])


@pytest.mark.parametrize("jump_s", [-50.0, 50.0])
def test_step_of_simulated_time_is_published_at_once(jump_s: float) -> None:
    row = into("clock_in")
    steady = [(0.1 * n, 100.0 + 0.1 * n) for n in range(5)]
    found = ticks(row, [*steady, (0.5, 100.5 + jump_s)])
    assert [tick.sim_ns / NS_PER_S for tick in found] == pytest.approx([100.0, 100.3, 100.5 + jump_s])
    assert found[-1].speed == pytest.approx(1.0)


def test_tick_is_immediate_when_wall_time_steps_back() -> None:
    found = ticks(into("clock_in"), [(0.0, 100.0), (0.1, 100.1), (-50.0, 100.2)])
    assert [(tick.stamp_ns - NOW_NS) // NS_PER_S for tick in found] == [0, -50]
    found = ticks(into("clock_in"), [(0.5 * n, 100.0) for n in range(8)])
    assert found[-1].speed == pytest.approx(0.01)
    assert "before 0" in warned(taken(into("clock_in"), clock(-1.0)))


YAW_RAD = 0.7
MOUNT = rotation.from_axis_angle((0.6, 0.0, 0.8), 1.1)
NONE = (0.0, 0.0, 0.0, 0.0)
"""Orientation of a message that states none."""


def posed(q: Quaternion, *, stamp_ns: int = NOW_NS, frame: str = "world") -> Any:
    value = jazzy().make(
        "geometry_msgs/msg/PoseStamped", header=stamped(stamp_ns, frame), pose=pose_at((1.0, 2.0, 0.0))
    )
    value.pose.orientation = quaternion(q)
    return value


def converted(name: str, value: Any, scene: ConversionState, now_ns: int = NOW_NS) -> Any:
    found = into(name).convert(value, "user1", scene, now_ns=now_ns, wall_ns=now_ns)
    return found[0] if found else None


def wave(scene: ConversionState, begin_ns: int, duration_s: float, *, epoch: int = 0) -> int:
    """Move the arm with wrist and body; return the time of the end."""
    now_ns = begin_ns
    for tick in range(round(50 * duration_s)):
        now_ns = begin_ns + tick * NS_PER_S // 50
        time_s = tick / 50
        arm = rotation.from_azimuth_elevation(
            0.3 * math.sin(7.0 * time_s), 0.3 * math.sin(5.0 * time_s + 1.0), 0.3 * math.sin(9.0 * time_s)
        )
        body = rotation.multiply(rotation.multiply(rotation.from_yaw(YAW_RAD), arm), MOUNT)
        assert converted("mocap_forearm", posed(body, stamp_ns=now_ns), scene, now_ns) is None
        scene.take("user1", ImuSample(stamp_ns=now_ns, orientation_xyzw=arm, yaw_epoch=epoch), now_ns)
    return now_ns


def test_pose_yaw_is_that_of_the_forearm_body() -> None:
    scene = furnished()
    now_ns = wave(scene, NOW_NS, 3.0)
    for q in (NONE, rotation.from_yaw(-2.0)):
        output = converted("mocap_pose", posed(q, stamp_ns=now_ns), scene, now_ns)
        assert isinstance(output, BusOutput), output
        pose: Any = output.what
        assert (pose.method, pose.position_m) == ("external", (1.0, 2.0, 0.0))
        assert pose.yaw_rad == pytest.approx(YAW_RAD, abs=math.radians(0.3))
        assert 0.0 < math.sqrt(pose.covariance[8]) < math.radians(1.0)


def test_pose_is_refused_until_the_forearm_has_moved() -> None:
    scene = furnished()
    assert converted("mocap_forearm", posed(MOUNT), scene) is None
    warning = converted("mocap_pose", posed(rotation.IDENTITY), scene)
    assert isinstance(warning, ConversionWarning)
    assert warning.sentence.startswith("the yaw of user1 is not known: move the arm")


def test_yaw_is_unknown_again_when_its_origin_changes() -> None:
    scene = furnished()
    now_ns = wave(scene, NOW_NS, 3.0)
    assert isinstance(converted("mocap_pose", posed(NONE, stamp_ns=now_ns), scene, now_ns), BusOutput)
    now_ns = wave(scene, now_ns + NS_PER_S // 50, 0.1, epoch=1)
    last = converted("mocap_pose", posed(NONE, stamp_ns=now_ns), scene, now_ns)
    assert isinstance(last, BusOutput)
    pose: Any = last.what
    assert math.sqrt(pose.covariance[8]) > math.radians(90.0), "the pose that stays says that it is unknown"
    assert isinstance(converted("mocap_pose", posed(NONE), scene, now_ns), ConversionWarning)


def test_tf_poses_have_the_yaw_of_the_forearm_body() -> None:
    scene = furnished()
    scene.person("user1").is_here = True
    now_ns = wave(scene, NOW_NS, 3.0)
    frames = [transform("world", "user1/human_footprint", (1.0, 2.0, 0.0), rotation.from_yaw(2.0), now_ns)]
    value = jazzy().make("tf2_msgs/msg/TFMessage", transforms=frames)
    (output,) = Poses().tf(value, ConversionContext(scene, "", now_ns, "world", now_ns))
    assert isinstance(output, BusOutput)
    pose: Any = output.what
    assert pose.yaw_rad == pytest.approx(YAW_RAD, abs=math.radians(0.3))


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (posed(NONE), "the forearm's body of user1 is not a rotation"),
        (posed(MOUNT, frame="odom"), "in the frame 'odom': send it in 'world'"),
        (posed(MOUNT, stamp_ns=NOW_NS - 60 * NS_PER_S), "behind the site's clock"),
    ],
)
def test_a_forearm_that_cannot_be_one_is_reported(value: Any, reason: str) -> None:
    warning = converted("mocap_forearm", value, furnished())
    assert isinstance(warning, ConversionWarning)
    assert reason in warning.sentence


def test_tf_gives_the_poses_of_the_people_who_are_known() -> None:
    row = into("tf_in")
    scene = furnished()
    scene.person("user1")
    scene.person("user2")
    frames = [("base_link", "odom"), ("user1/human_footprint",), ("user3/human_footprint",)]
    found = taken(row, tf(*(frame_of(*each) for each in [*frames, ("user2/human_footprint", "odom")])), scene)
    assert [(each.at, each.name) for each in found[:-1] if isinstance(each, BusOutput)] == [(POSE, "user1")]
    assert warned(found[-1:]) == "the pose of user2 is in the frame 'odom': send it in 'world'"
    assert scene.person("user1").tf_until_ns == NOW_NS + MAX_TF_AGE_NS
    assert scene.person("user2").tf_until_ns == 0


def test_tf_poses_are_limited_in_rate() -> None:
    row = into("tf_in")
    scene = furnished()
    scene.person("user1")
    times = [0, 1, SOONEST_NS - 1, SOONEST_NS, SOONEST_NS + 5, -NS_PER_S]  # at last the clock is set back
    value = tf(frame_of("user1/human_footprint"))
    assert [len(taken(row, value, scene, now_ns=NOW_NS + each)) for each in times] == [1, 0, 0, 1, 0, 1]


def test_static_frame_sets_the_pose_once() -> None:
    row = into("tf_static_in")
    scene = furnished()
    scene.person("user1")
    one = output(taken(row, tf(frame_of("user1/human_footprint")), scene))
    assert (one.at, one.name, one.what.position_m) == (SET_POSE, "user1", (1.0, 2.0, 0.0))
    assert one.what.yaw_rad == pytest.approx(1.0)
    assert scene.person("user1").tf_until_ns > NOW_NS + 3600 * NS_PER_S
    assert "not a position" in warned(taken(row, tf(frame_of("user1/human_footprint", x=1e9)), scene))
    assert "in the frame 'map'" in warned(taken(row, tf(frame_of("user1/human_footprint", "map")), scene))


def test_static_frame_published_earlier_sets_the_pose_on_arrival() -> None:
    row = into("tf_static_in")
    scene = furnished()
    frames = tf(frame_of("anna/human_footprint"), frame_of("ben/human_footprint", "map"))
    assert taken(row, frames, scene) == []
    assert row.on_presence is not None
    one = output([*row.on_presence(ConversionContext(scene, "anna", NOW_NS))])
    assert (one.at, one.name, one.what.position_m) == (SET_POSE, "anna", (1.0, 2.0, 0.0))
    assert row.on_presence(ConversionContext(scene, "ben", NOW_NS)) == (), "in another frame"
    for count in range(MAX_TRANSFORMS):
        taken(row, tf(frame_of(f"box_{count}")), scene)
    kept = row.on_presence(ConversionContext(scene, "anna", NOW_NS))
    assert kept == (), "the number of those that are kept is bounded"
