"""Poses, arms and objects as drivers of others write them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from pointit.bridges.ros2.config import PoseSource, TrackerConfig
from pointit.bridges.ros2.inbound.person import REPLACED_NS, people_in
from pointit.bridges.ros2.robot.pose_input import PoseReader
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionWarning
from pointit.bridges.ros2.sightings import AT_ORIGIN, TransformBuffer
from pointit.bridges.ros2.trackers import tracker_routes
from pointit.geometry.rotation import Quaternion
from pointit.plugins import NS_PER_S, RobotReport
from pointit.schemas import TrackedObject, TrackedObjects, UserPose, WristSample
from pointit.schemas.environment import Frame
from tests.unit.ros2.scenes import NOW_NS, ROOM, into, jazzy, pose_at, quaternion, stamped, transform, triple

NAN = math.nan
QUARTER = math.sqrt(0.5)
UP = (0.0, 0.0, 0.0, 1.0)
"""Orientation of a robot that faces x."""
BACKWARDS = (0.0, 0.0, 1.0, 0.0)
"""Orientation of one that faces -x."""
LEFT = (0.0, 0.0, QUARTER, QUARTER)
"""Orientation of one that faces y."""
POSE = "geometry_msgs/msg/PoseStamped"
DETECTIONS = "vision_msgs/msg/Detection3DArray"
TF = "tf2_msgs/msg/TFMessage"
IMU = "sensor_msgs/msg/Imu"

make = jazzy().make


def decoded(name: str, **fields: Any) -> Any:
    """Return a value after its way through CDR."""
    return jazzy().decode(name, jazzy().encode(name, make(name, **fields)))


def posed(x: float, turned: Quaternion = UP) -> Any:
    return pose_at((x, 2.0, 0.0), turned)


def matrix(*diagonal: float, rest: float = 0.0) -> Any:
    values = np.full((6, 6), rest)
    np.fill_diagonal(values, (*diagonal, *(0.0,) * (6 - len(diagonal))))
    return values.reshape(36)


UNKNOWN = matrix()


def odometry(
    *,
    frame: str = "map",
    child: str = "base_link",
    turned: Quaternion = BACKWARDS,
    forward_mps: float = 0.5,
    covariance: Any = UNKNOWN,
    twist_covariance: Any = UNKNOWN,
    x: float = 1.0,
    stamp_ns: int = NOW_NS,
) -> Any:
    twist = make("geometry_msgs/msg/Twist", linear=triple("Vector3", (forward_mps, 0.0, 0.0)))
    return decoded(
        "nav_msgs/msg/Odometry",
        header=stamped(stamp_ns, frame),
        child_frame_id=child,
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=posed(x, turned), covariance=covariance),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=twist_covariance),
    )


def transforms(*links: tuple[str, str, float], turned: Quaternion = UP, stamp_ns: int = NOW_NS) -> bytes:
    """Return a message of transforms along x, encoded."""
    made = [transform(parent, child, (x, 0.0, 0.0), turned, stamp_ns) for parent, child, x in links]
    return jazzy().encode(TF, make(TF, transforms=made))


def reader(frame: str = "map") -> PoseReader:
    return PoseReader(PoseSource(type="nav_msgs/Odometry", topic="/agv1/odom"), frame)


def report(value: Any, robot: PoseReader | None = None, *, now_ns: int = NOW_NS) -> RobotReport:
    found = (robot or reader()).message(value, now_ns)
    assert isinstance(found, RobotReport), found
    return found


@pytest.mark.parametrize(
    ("frame", "child", "turned", "expected"),
    [
        ("map", "base_link", BACKWARDS, (-0.5, 0.0, 0.0)),
        ("map", "", BACKWARDS, (-0.5, 0.0, 0.0)),
        ("map", "agv1/base_footprint", LEFT, (0.0, 0.5, 0.0)),
        ("map", "map", BACKWARDS, (0.5, 0.0, 0.0)),
        ("map", "/map", LEFT, (0.5, 0.0, 0.0)),
        ("/map", "map", LEFT, (0.5, 0.0, 0.0)),
        ("", "map", LEFT, (0.5, 0.0, 0.0)),
    ],
)
def test_a_twist_is_in_the_frame_that_the_message_names(
    frame: str, child: str, turned: Quaternion, expected: tuple[float, float, float]
) -> None:
    found = report(odometry(frame=frame, child=child, turned=turned))
    assert found.velocity_mps == pytest.approx(expected)


@pytest.mark.parametrize("frame", ["agv1/odom", "map"])
def test_twist_in_a_rotated_fixed_frame_is_rotated(frame: str) -> None:
    robot = reader()
    still = jazzy().decode(TF, transforms(("map", "agv1/odom", 3.0), turned=LEFT))
    assert robot.transforms(still, NOW_NS, is_static=True) == ""
    found = report(odometry(frame=frame, child="agv1/odom", turned=BACKWARDS), robot)
    assert found.velocity_mps == pytest.approx((0.0, 0.5, 0.0))


def test_twist_in_an_unknown_frame_is_left_out_and_reported() -> None:
    robot = reader()
    second_ns = NOW_NS + NS_PER_S // 10
    for stamp_ns, x in ((NOW_NS, 1.0), (second_ns, 1.1)):
        found = report(odometry(child="odom", x=x, stamp_ns=stamp_ns), robot, now_ns=second_ns)
    assert found.velocity_mps[0] > 0.0, "by its positions"
    assert robot.problem.startswith("the twist is left out: no transform leads from 'odom' to 'map'")


@pytest.mark.parametrize(
    ("covariance", "sigma_m"),
    [
        (matrix(*(NAN,) * 6, rest=NAN), None),
        (matrix(NAN, 0.0, 0.0), None),  # PX4
        (matrix(-1.0), None),
        (matrix(*(-1.0,) * 6, rest=-1.0), None),
        (matrix(), None),
        (matrix(0.04, 0.09, NAN, NAN, NAN, 0.1), 0.3),
        (matrix(0.1, 0.1, 1.7976931348623157e308, 1.7976931348623157e308), math.sqrt(0.1)),  # kobuki
        (matrix(0.04, 0.09, math.inf), 0.3),
        (matrix(0.04, 0.09, -1.0), 0.3),
        (matrix(0.04, 0.04, 0.04, rest=NAN), 0.2),
        (matrix(math.inf, math.inf, math.inf), None),
    ],
)
def test_a_covariance_that_is_unknown_leaves_the_pose(covariance: Any, sigma_m: float | None) -> None:
    robot = reader()
    found = report(odometry(covariance=covariance), robot)
    assert found.position_m == (1.0, 2.0, 0.0)
    assert found.position_sigma_m == (None if sigma_m is None else pytest.approx(sigma_m))
    assert robot.problem == ""


def test_invalid_covariance_is_reported_and_the_pose_is_used() -> None:
    robot = reader()
    found = report(odometry(covariance=matrix(0.1, 0.1, 0.1, rest=1e9)), robot)
    assert (found.position_m, found.position_sigma_m) == ((1.0, 2.0, 0.0), None)
    assert "the covariance is none" in robot.problem


@pytest.mark.parametrize("speed_mps", [NAN, math.inf, 1e9])
def test_invalid_twist_is_reported_and_the_pose_is_used(speed_mps: float) -> None:
    robot = reader()
    found = report(odometry(forward_mps=speed_mps), robot)
    assert (found.position_m, found.velocity_mps) == ((1.0, 2.0, 0.0), (0.0, 0.0, 0.0))
    assert robot.problem.startswith("the twist is no velocity: (")
    again = odometry(stamp_ns=NOW_NS + NS_PER_S // 10)
    report(again, robot, now_ns=NOW_NS + NS_PER_S // 10)
    assert robot.problem == ""


@pytest.mark.parametrize("variance", [-1.0, 1e6, 0.0, NAN])  # with 0 nothing was filled in
def test_unmeasured_twist_is_computed_from_positions(variance: float) -> None:
    robot = reader()
    found = [
        report(
            odometry(
                x=0.1 * step,
                forward_mps=0.0,
                twist_covariance=matrix(variance),
                stamp_ns=NOW_NS + step * NS_PER_S // 10,
            ),
            robot,
            now_ns=NOW_NS + NS_PER_S,
        )
        for step in range(10)
    ]
    assert found[-1].velocity_mps[0] > 0.9


def test_a_twist_of_0_with_a_covariance_is_stated() -> None:
    robot = reader()
    for step in range(5):
        stamp_ns = NOW_NS + step * NS_PER_S // 10
        twist = odometry(x=0.1 * step, forward_mps=0.0, twist_covariance=matrix(0.01), stamp_ns=stamp_ns)
        assert report(twist, robot, now_ns=stamp_ns).velocity_mps == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("turned", [(0.0, 0.0, 0.0, 0.0), (NAN, NAN, NAN, NAN)])
def test_robot_without_a_heading_keeps_its_last_one(turned: Quaternion) -> None:
    robot = reader()
    refused = robot.message(odometry(turned=turned), NOW_NS)
    assert isinstance(refused, str)
    assert "is not a rotation" in refused
    report(odometry(turned=LEFT), robot)
    later_ns = NOW_NS + NS_PER_S // 10
    found = report(odometry(turned=turned, x=1.2, stamp_ns=later_ns), robot, now_ns=later_ns)
    assert found.position_m == (1.2, 2.0, 0.0)
    assert found.yaw_rad == pytest.approx(math.pi / 2)
    assert "is not a rotation" in robot.problem


@pytest.mark.parametrize("frame", ["map", "/map", "//map"])
@pytest.mark.parametrize("configured", ["map", "/map"])
def test_a_slash_before_a_frame_makes_no_difference(frame: str, configured: str) -> None:
    assert report(odometry(frame=frame), reader(configured)).position_m == (1.0, 2.0, 0.0)


def test_a_frame_of_another_namespace_is_another_one() -> None:
    refused = reader().message(odometry(frame="/agv2/map"), NOW_NS)
    assert isinstance(refused, str)
    assert refused.startswith("no transform leads from 'agv2/map' to 'map': publish one on /tf or /tf_static")


@pytest.mark.parametrize("name", ["agv1/base_link", "/agv1/base_link"])
def test_transforms_with_slashes_are_read_and_chained(name: str) -> None:
    robot = PoseReader(PoseSource(type="tf", frame=name), "/map")
    cdr = transforms(("/map", "/agv1/odom", 1.0), ("agv1/odom", "/agv1/base_link", 2.0))
    assert robot.is_wanted(cdr)
    found = robot.transforms(jazzy().decode(TF, cdr), NOW_NS, is_static=False)
    assert isinstance(found, RobotReport)
    assert found.position_m == pytest.approx((3.0, 0.0, 0.0))


def test_moving_transform_without_a_stamp_has_its_arrival_time() -> None:
    buffer = TransformBuffer()
    value = jazzy().decode(TF, transforms(("map", "base_link", 1.0), stamp_ns=0))
    assert list(buffer.take(value, is_static=False, now_ns=NOW_NS)) == []
    placed = buffer.placed("base_link", {"map": AT_ORIGIN}, NOW_NS, 1.0)
    assert not isinstance(placed, str)
    assert placed.stamp_ns == NOW_NS
    assert isinstance(buffer.placed("base_link", {"map": AT_ORIGIN}, NOW_NS + 2 * NS_PER_S, 1.0), str)


def tracked(type_: str, value: Any, **config: Any) -> tuple[list[TrackedObject], list[str]]:
    """Return the objects of a tracker after a message, and its warnings."""
    source: Any = {"type": type_, "topic": "/x", **config}
    row = tracker_routes({"seen": TrackerConfig.model_validate(source)})[0]
    scene = ConversionState(jazzy(), world="/map")
    frame = Frame(id="lab", position_m=(0.0, 0.0, 0.0), orientation_xyzw=LEFT)
    scene.take("", ROOM.model_copy(update={"frames": (frame,)}), NOW_NS)
    objects: list[TrackedObject] = []
    warnings: list[str] = []
    for each in row.convert(value, "", scene, now_ns=NOW_NS, wall_ns=NOW_NS):
        if isinstance(each, ConversionWarning):
            warnings.append(each.sentence)
        elif isinstance(each.what, TrackedObjects):
            objects += each.what.objects
    return objects, warnings


def test_a_tracker_reads_odometry_as_a_robots_driver_does() -> None:
    ((item,), warnings) = tracked("nav_msgs/Odometry", odometry(frame="/map", child="lab"))
    assert item.velocity_mps == pytest.approx((0.0, 0.5, 0.0)), "in a frame of the site's map"
    assert warnings == []
    ((item,), warnings) = tracked("nav_msgs/Odometry", odometry(covariance=matrix(NAN), forward_mps=NAN))
    assert (item.position_m, item.position_sigma_m) == ((1.0, 2.0, 0.0), None)
    assert len(warnings) == 1
    assert warnings[0].startswith("the twist is no velocity")


@pytest.mark.parametrize("turned", [(0.0, 0.0, 0.0, 0.0), (NAN, 0.0, 0.0, 1.0)])
def test_object_without_an_orientation_has_a_position_and_no_heading(turned: Quaternion) -> None:
    value = decoded(POSE, header=stamped(frame="/map"), pose=posed(1.0, turned))
    ((item,), warnings) = tracked("geometry_msgs/PoseStamped", value)
    assert (item.position_m, item.yaw_rad) == ((1.0, 2.0, 0.0), None)
    assert ["is not a rotation" in each for each in warnings] == [True]


def test_detection_has_its_position_without_size_or_covariance() -> None:
    result = make(
        "vision_msgs/msg/ObjectHypothesisWithPose",
        hypothesis=make("vision_msgs/msg/ObjectHypothesis", class_id="cup", score=0.9),
        pose=make("geometry_msgs/msg/PoseWithCovariance", covariance=matrix(NAN, rest=NAN)),
    )
    found: list[Any] = []
    for number, size_m in enumerate(((NAN, NAN, NAN), (-1.0, 0.2, 0.2), (0.1, 0.3, 0.2))):
        box = make(
            "vision_msgs/msg/BoundingBox3D", center=posed(float(number)), size=triple("Vector3", size_m)
        )
        header = stamped(frame="/map")
        found.append(
            make("vision_msgs/msg/Detection3D", header=header, results=[result], bbox=box, id=f"{number}")
        )

    items, warnings = tracked(
        "vision_msgs/Detection3DArray", decoded(DETECTIONS, header=stamped(), detections=found)
    )
    assert [(each.position_m[0], each.length_m) for each in items] == [(0.0, 0.0), (1.0, 0.0), (2.0, 0.3)]
    assert [each.partition(" is ")[0] for each in warnings] == [
        "the size of detection '0'",
        "the size of detection '1'",
    ]


def scene_of(user: str) -> ConversionState:
    scene = ConversionState(jazzy(), world="/map")
    scene.person(user).is_here = True
    return scene


def outputs_of(route: str, value: Any, *, user: str = "", scene: ConversionState | None = None) -> list[Any]:
    converted: Sequence[Any] = into(route).convert(
        value, user, scene or scene_of("anna"), now_ns=NOW_NS, wall_ns=NOW_NS
    )
    return [each.what for each in converted if isinstance(each, BusOutput)]


@pytest.mark.parametrize(
    ("parent", "child"), [("map", "anna/human_footprint"), ("/map", "/anna/human_footprint")]
)
def test_a_persons_pose_is_read_with_and_without_slashes(parent: str, child: str) -> None:
    scene = scene_of("anna")
    cdr = transforms((parent, child, 4.0))
    assert people_in(cdr, scene) == ("anna",)
    (pose,) = outputs_of("tf_in", jazzy().decode(TF, cdr), scene=scene)
    assert isinstance(pose, UserPose)
    assert pose.position_m == (4.0, 0.0, 0.0)
    value = decoded(POSE, header=stamped(frame=parent), pose=posed(5.0))
    (pose,) = outputs_of("mocap_pose", value, user="anna")
    assert pose.position_m == (5.0, 2.0, 0.0)


@pytest.mark.parametrize(
    ("turned", "variance", "is_read"),
    [
        (LEFT, 0.0, True),  # all 0: unknown
        (LEFT, NAN, True),
        (LEFT, -1.0, False),  # measures none
        ((0.0, 0.0, 0.0, 0.0), 0.0, False),
    ],
)
def test_imu_is_read_by_its_stated_orientation_covariance(
    turned: Quaternion,
    variance: float,
    is_read: bool,
) -> None:
    value = imu("/imu_link", turned, variance, linear_acceleration_covariance=[NAN] * 9)
    (one,) = into("imu_in").convert(value, "anna", scene_of("anna"), now_ns=NOW_NS, wall_ns=NOW_NS)
    if is_read:
        assert isinstance(one, BusOutput)
        assert isinstance(one.what, WristSample)
    else:
        assert isinstance(one, ConversionWarning)


def imu(frame: str, turned: Quaternion, variance: float = 0.0, stamp_ns: int = NOW_NS, **fields: Any) -> Any:
    covariance = [variance, *(0.0,) * 8]
    return decoded(
        IMU,
        header=stamped(stamp_ns, frame),
        orientation=quaternion(turned),
        orientation_covariance=covariance,
        **fields,
    )


def test_imu_in_another_frame_is_reported_and_not_used() -> None:
    route = into("imu_in")
    scene = scene_of("anna")
    samples: list[WristSample] = []
    warnings: set[str] = set()

    def send(frame: str, turned: Quaternion, now_ns: int) -> None:
        value = imu(frame, turned, stamp_ns=now_ns)
        for each in route.convert(value, "anna", scene, now_ns=now_ns, wall_ns=now_ns):
            if isinstance(each, ConversionWarning):
                warnings.add(each.sentence)
            elif isinstance(each.what, WristSample):
                samples.append(each.what)

    for step in range(10):
        frame, turned = (("/wrist_imu", LEFT), ("elbow_imu", (0.0, 0.0, 0.0, 1.0)))[step % 2]
        send(frame, turned, NOW_NS + step * 10**7)
    assert [each.orientation_xyzw for each in samples] == [pytest.approx(LEFT)] * 5
    (warning,) = warnings
    assert "that of frame 'wrist_imu' is used, not that of 'elbow_imu'; let only one" in warning
    send("elbow_imu", LEFT, NOW_NS + 2 * REPLACED_NS)
    assert len(samples) == 6


def test_transform_dated_ahead_is_used_after_its_remedy() -> None:
    cdr = transforms(("map", "base_link", 1.0), stamp_ns=NOW_NS + 1_050_000_000)
    value = jazzy().decode(TF, cdr)
    robot = PoseReader(PoseSource(type="tf", frame="base_link"), "map")
    robot.is_wanted(cdr)
    refusal = robot.transforms(value, NOW_NS, is_static=False)
    assert isinstance(refusal, str)
    assert "set a larger stale_s" in refusal

    patient = PoseReader(PoseSource(type="tf", frame="base_link", stale_s=2.0), "map")
    patient.is_wanted(cdr)
    assert isinstance(patient.transforms(value, NOW_NS, is_static=False), RobotReport)
