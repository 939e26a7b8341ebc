"""Objects that ROS nodes track, on our bus; what chains of transforms lead to, and when they are refused."""

import dataclasses
import math
from collections.abc import AsyncGenerator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.config import Ros2Config, TrackerConfig
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionWarning, InboundRoute
from pointit.bridges.ros2.routing.routes import routes
from pointit.bridges.ros2.sightings import AT_ORIGIN, Pose, TransformBuffer, compose, yaw
from pointit.bridges.ros2.trackers import Motion, tracker_routes
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S, TrackedObjects, decode, encode
from pointit.schemas.environment import Frame
from pointit.schemas.topics import OBJECTS
from tests.support.bench import START_NS, until
from tests.unit.ros2 import scenes
from tests.unit.ros2.graph_of_one import Bench, bench
from tests.unit.ros2.scenes import NOW_NS, ROOM, furnished, jazzy
from tests.unit.ros2.values import any_value

POSE = "geometry_msgs/msg/PoseStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
PACKAGES = "conveyor_msgs/msg/PackageList"
DETECTIONS = "vision_msgs/msg/Detection3DArray"
TF = "tf2_msgs/msg/TFMessage"
LATENCY_S = 0.02
Seen = dict[str, list[TrackedObjects]]

CONFIG = {
    "agv1": {
        "topic": "/agv1/pose",
        "kind": "ground",
        "size_m": 0.6,
        "latency_s": LATENCY_S,
        "latency_sigma_s": 0.005,
    },
    "agv2": {"topic": "/agv2/odom", "type": "nav_msgs/Odometry", "id": "agv-2"},
    "quad": {"type": "tf", "frame": "cf1"},
    "line": {"topic": "/packages", "type": "conveyor_msgs/PackageList"},
    "camera": {"topic": "/detections", "type": "vision_msgs/Detection3DArray", "frame": "camera"},
}


def configured() -> dict[str, TrackerConfig]:
    return Ros2Config.model_validate({"trackers": CONFIG}).trackers


def make(name: str, /, **fields: Any) -> Any:
    return jazzy().make(name, **fields)


def header(frame: str = "", stamp_ns: int = START_NS) -> Any:
    return scenes.stamped(stamp_ns, frame)


def pose(x: float = 0.0, y: float = 0.0, yaw_rad: float = 0.0) -> Any:
    return scenes.pose_at((x, y, 0.0), rotation.from_yaw(yaw_rad))


def covariance(x_m2: float, y_m2: float, z_m2: float) -> list[float]:
    values = [0.0] * 36
    values[0] = x_m2
    values[7] = y_m2
    values[14] = z_m2
    return values


def transform(parent: str, child: str, x: float = 0.0, yaw_rad: float = 0.0, stamp_ns: int = START_NS) -> Any:
    return scenes.transform(parent, child, (x, 0.0, 0.0), rotation.from_yaw(yaw_rad), stamp_ns)


@pytest.fixture
async def bridge() -> AsyncGenerator[Bench]:
    """The bridge with all trackers and no other route."""
    table = dataclasses.replace(routes(), outward=(), inward=tracker_routes(configured()), served=())
    async with bench(jazzy(), table) as made:
        made.scene.take("", ROOM, START_NS)
        yield made


@pytest.fixture
def seen(bridge: Bench) -> Seen:
    """Return the objects that the trackers publish."""
    told: Seen = {name: [] for name in CONFIG}
    bridge.other.subscribe(OBJECTS, lambda message, name: told[name].append(message))
    return told


async def test_a_pose_becomes_an_object_stamped_when_it_was_measured(bridge: Bench, seen: Seen) -> None:
    bridge.say("/agv1/pose", POSE, header=header("world"), pose=pose(1.0, 2.0, 0.5))
    await until(lambda: bool(seen["agv1"]))
    (message,) = seen["agv1"]
    (item,) = message.objects
    assert message.stamp_ns == START_NS - round(LATENCY_S * NS_PER_S)
    assert message.latency_sigma_s == 0.005
    assert (item.id, item.kind, item.length_m) == ("agv1", "ground", 0.6)
    assert (item.position_m, item.position_sigma_m) == ((1.0, 2.0, 0.0), None)
    assert item.yaw_rad == pytest.approx(0.5)


async def test_odometry_gives_velocity_in_the_room_and_sigma_by_covariance(bridge: Bench, seen: Seen) -> None:
    bridge.say("/tf_static", TF, transforms=[transform("world", "odom", 10.0, math.pi / 2)])
    bridge.say(
        "/agv2/odom",
        ODOMETRY,
        header=header("odom"),
        pose=make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=pose(1.0, 0.0, math.pi / 2),
            covariance=covariance(0.01, 0.04, 1e6),
        ),
        twist=make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=make("geometry_msgs/msg/Twist", linear=scenes.triple("Vector3", (0.5, 0.0, 0.0))),
        ),
    )
    await until(lambda: bool(seen["agv2"]))

    (item,) = seen["agv2"][0].objects
    assert (item.id, item.kind) == ("agv-2", "robot")
    assert item.position_m == pytest.approx((10.0, 1.0, 0.0))
    assert item.velocity_mps == pytest.approx((-0.5, 0.0, 0.0))
    assert item.yaw_rad is not None
    assert abs(item.yaw_rad) == pytest.approx(math.pi)
    assert item.position_sigma_m == pytest.approx(0.2)


async def test_tf_frame_becomes_an_object_when_its_chain_is_complete(bridge: Bench, seen: Seen) -> None:
    moving = transform("map", "cf1", 3.0, stamp_ns=START_NS - NS_PER_S // 10)
    bridge.say("/tf", TF, transforms=[moving, transform("map", "another")])
    assert any("no transform leads from 'map' to 'world'" in each for each in bridge.warnings())
    bridge.say("/tf_static", TF, transforms=[transform("world", "map", 1.0)])
    bridge.clock.advance(0.1)
    bridge.say("/tf", TF, transforms=[transform("map", "cf1", 3.1, stamp_ns=START_NS)])
    await until(lambda: bool(seen["quad"]))
    (message,) = seen["quad"]
    assert message.stamp_ns == START_NS
    assert message.objects[0].position_m == pytest.approx((4.1, 0.0, 0.0))
    assert bridge.warnings() == ()


async def test_packages_of_the_ros_toolkit_keep_their_numbers(bridge: Bench, seen: Seen) -> None:
    place = make("conveyor_msgs/msg/PositionOnStrip", name="part_b", position=0.5)
    item = make("conveyor_msgs/msg/Package", uid=19, position=place, type=1, length=0.25)
    nowhere = make("conveyor_msgs/msg/Package", uid=20)
    bridge.say("/packages", PACKAGES, header=header("world"), packages=[item, nowhere])
    await until(lambda: bool(seen["line"]))
    (found,) = seen["line"][0].objects
    assert (found.id, found.kind, found.length_m) == ("line-19", "red", 0.25)
    assert (found.surface, found.surface_id, found.surface_position_m) == ("belt", "part_b", 1.5)
    assert found.position_m == pytest.approx((1.5, 5.0, 0.0))
    assert bridge.scene.uids.number("line-19") == 19
    assert any("package 20 is on '', which is no line of the map" in each for each in bridge.warnings())


async def test_detections_are_objects_of_their_likeliest_class(bridge: Bench, seen: Seen) -> None:
    bridge.say("/tf_static", TF, transforms=[transform("world", "camera", 5.0)])
    results = [
        make(
            "vision_msgs/msg/ObjectHypothesisWithPose",
            hypothesis=make("vision_msgs/msg/ObjectHypothesis", class_id=name, score=score),
            pose=make("geometry_msgs/msg/PoseWithCovariance", covariance=covariance(0.01, 0.01, 0.01)),
        )
        for name, score in (("chair", 0.2), ("robot_arm", 0.7))
    ]
    box = make(
        "vision_msgs/msg/BoundingBox3D", center=pose(1.0), size=scenes.triple("Vector3", (0.2, 0.5, 0.1))
    )
    found = make("vision_msgs/msg/Detection3D", results=results, bbox=box, id="7")
    bridge.say("/detections", DETECTIONS, header=header(), detections=[found])
    bridge.clock.advance(0.1)

    await until(lambda: bool(seen["camera"]))
    (item,) = seen["camera"][0].objects
    assert (item.id, item.kind, item.length_m, item.yaw_rad) == ("camera-7", "robot_arm", 0.5, None)
    assert item.position_m == pytest.approx((6.0, 0.0, 0.0))
    assert item.position_sigma_m == pytest.approx(0.1)

    later = header(stamp_ns=START_NS + NS_PER_S // 10)
    bridge.say("/detections", DETECTIONS, header=later, detections=[])
    await until(lambda: len(seen["camera"]) == 2)
    assert seen["camera"][1].objects == ()  # it has left


async def test_a_frame_of_the_map_needs_no_transform(bridge: Bench, seen: Seen) -> None:
    frame = Frame(id="odom", position_m=(5.0, 0.0, 0.0), orientation_xyzw=rotation.from_yaw(math.pi / 2))
    bridge.scene.take("", ROOM.model_copy(update={"frames": (frame,)}), START_NS)
    bridge.say("/agv1/pose", POSE, header=header("odom"), pose=pose(1.0))
    await until(lambda: bool(seen["agv1"]))
    assert seen["agv1"][0].objects[0].position_m == pytest.approx((5.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("bad", "expected"),
    [
        ({"header": header("world", START_NS - 2 * NS_PER_S)}, "is 2.0 s old, limit 1 s"),
        ({"header": header("world", START_NS + 3 * NS_PER_S)}, "is 3.0 s ahead of the site's clock"),
        ({"header": header("moon")}, "no transform leads from 'moon'"),
        ({"header": header("world"), "pose": pose(1e7)}, "is not a position"),
    ],
)
async def test_bad_poses_are_refused_with_one_sentence(
    bridge: Bench, seen: Seen, bad: dict[str, Any], expected: str
) -> None:
    bridge.say("/agv1/pose", POSE, **bad)
    (warning,) = bridge.warnings()
    assert expected in warning
    assert not seen["agv1"]


def test_repeated_and_overtaken_messages_are_published_once() -> None:
    row = next(each for each in tracker_routes(configured()) if each.ros == "/agv1/pose")
    scene = furnished()
    counts = list[int]()
    for ahead_s in (0.0, 0.0, -0.1, 0.1):
        said = make(POSE, header=header("world", NOW_NS + round(ahead_s * NS_PER_S)), pose=pose())
        counts.append(len(row.convert(said, "", scene, now_ns=NOW_NS, wall_ns=NOW_NS)))
    assert counts == [1, 0, 0, 1]


def test_velocity_converges_in_steady_motion_and_restarts_after_gaps() -> None:
    motion = Motion()
    speed_mps = 0.8
    found = (0.0, 0.0, 0.0)
    for tick in range(60):
        at_s = tick / 25.0
        found = motion.velocity_mps("a", (speed_mps * at_s, 0.0, 0.0), NOW_NS + round(at_s * NS_PER_S))
    assert found == pytest.approx((speed_mps, 0.0, 0.0), abs=1e-3)
    assert motion.velocity_mps("a", (9.0, 0.0, 0.0), NOW_NS + 9 * NS_PER_S) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("trackers", "expected"),
    [
        ({"a": {"type": "tf"}}, "frame"),
        ({"a": {}}, "topic"),
        ({"a": {"topic": "agv1/pose"}}, "begin with /"),
        ({"a": {"topic": "/x"}, "b": {"topic": "/x"}}, "read by two trackers"),
        ({"a/b": {"topic": "/x"}}, "a/b"),
    ],
)
def test_a_tracker_that_cannot_work_is_a_configuration_error(trackers: Any, expected: str) -> None:
    layers = Layers()
    layers.add({"trackers": trackers}, "site.yaml")
    with pytest.raises(ConfigError, match=expected):
        layers.build(Ros2Config)


ROWS = tuple({row.type: row for row in tracker_routes(configured())}.values())


@pytest.mark.parametrize("row", ROWS, ids=[row.type for row in ROWS])
@given(data=st.data())
def test_any_message_is_an_object_or_a_warning(row: InboundRoute, data: st.DataObject) -> None:
    fresh = next(each for each in tracker_routes(configured()) if each.type == row.type)
    scene = furnished()
    cdr = (
        data.draw(st.binary(max_size=200).map(lambda tail: b"\x00\x01\x00\x00" + tail))
        if data.draw(st.booleans())
        else jazzy().encode(row.type, data.draw(any_value(row.type)))
    )
    try:
        value = jazzy().decode(row.type, cdr)
    except ValueError:
        return
    if hasattr(value, "header"):
        value.header.stamp.sec = 0
        value.header.frame_id = ""
        value.header.stamp.nanosec = 0

    for found in fresh.convert(value, "", scene, now_ns=NOW_NS, wall_ns=NOW_NS):
        if isinstance(found, ConversionWarning):
            assert found.sentence
            assert "\n" not in found.sentence
            assert len(found.sentence) < 300
        else:
            assert isinstance(found, BusOutput)
            assert isinstance(found.what, TrackedObjects)
            assert decode(TrackedObjects, encode(found.what)) == found.what


ROOTS = {"world": AT_ORIGIN}
METRES = st.floats(-100.0, 100.0)
TURNS = st.floats(-math.pi, math.pi)


def tilted(at_m: Vec3, yaw_rad: float, tilt_rad: float) -> Pose:
    return Pose(at_m, rotation.from_azimuth_elevation(yaw_rad, tilt_rad))


POSES = st.builds(tilted, st.tuples(METRES, METRES, METRES), TURNS, st.floats(-1.0, 1.0))


def link(parent: str, child: str, pose: Pose = AT_ORIGIN, age_s: float = 0.0) -> Any:
    stamp_ns = NOW_NS - round(age_s * NS_PER_S)
    return scenes.transform(parent, child, pose.position_m, pose.orientation, stamp_ns)


def message(*transforms: Any) -> Any:
    return jazzy().make("tf2_msgs/msg/TFMessage", transforms=list(transforms))


def filled(*moving: Any, static: tuple[Any, ...] = ()) -> TransformBuffer:
    buffer = TransformBuffer()
    assert list(buffer.take(message(*moving), is_static=False)) == []
    assert list(buffer.take(message(*static), is_static=True)) == []
    return buffer


@given(st.lists(POSES, min_size=1, max_size=5), st.tuples(METRES, METRES, METRES))
def test_chain_equals_its_transforms_one_by_one(chain: list[Pose], at_m: Vec3) -> None:
    names = ["world", *(f"frame{count}" for count in range(len(chain)))]
    links = [link(names[count], names[count + 1], pose) for count, pose in enumerate(chain)]
    placed = filled(*links[1:], static=(links[0],)).placed(names[-1], ROOTS, NOW_NS, 1.0)
    assert not isinstance(placed, str)
    expected = at_m
    for pose in reversed(chain):
        expected = vector.add(pose.position_m, rotation.rotate(pose.orientation, expected))
    found = compose(placed.pose, Pose(at_m, rotation.IDENTITY)).position_m
    assert vector.norm(vector.subtract(found, expected)) < 1e-6


def test_stamp_is_that_of_the_nearest_moving_transform() -> None:
    buffer = filled(
        link("map", "odom", age_s=-0.2),
        link("odom", "base", age_s=0.1),
        static=(link("world", "map"), link("base", "lidar")),
    )
    placed = buffer.placed("lidar", ROOTS, NOW_NS, 1.0)
    assert not isinstance(placed, str)
    assert placed.stamp_ns == NOW_NS - NS_PER_S // 10


@pytest.mark.parametrize(
    ("links", "expected"),
    [
        ([("map", "base", 0.0)], "no transform leads from 'map' to 'world'"),
        ([("world", "odom", 1.5), ("odom", "base", 0.0)], "'world' to 'odom' is 1.5 s old, limit 1 s"),
        ([("world", "base", -1.5)], "is 1.5 s ahead, limit 1 s"),
        ([("odom", "base", 0.0), ("base", "odom", 0.0)], "go round in a circle"),
    ],
)
def test_a_frame_that_is_nowhere_is_refused(links: list[tuple[str, str, float]], expected: str) -> None:
    buffer = filled(*(link(parent, child, age_s=age_s) for parent, child, age_s in links))
    placed = buffer.placed("base", ROOTS, NOW_NS, 1.0)
    assert isinstance(placed, str)
    assert expected in placed


@pytest.mark.parametrize(
    ("bad", "expected"),
    [
        (link("odom", "odom"), "from a frame to itself"),
        (link("odom", "base", Pose((math.nan, 0.0, 0.0), rotation.IDENTITY)), "is not a position"),
        (link("odom", "base", Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))), "is not a rotation"),
    ],
)
def test_bad_transform_is_refused_and_the_previous_one_stays(bad: Any, expected: str) -> None:
    good = Pose((1.0, 2.0, 3.0), rotation.IDENTITY)
    buffer = filled(link("odom", "base", good), static=(link("world", "odom"),))
    (sentence,) = buffer.take(message(bad), is_static=False)
    assert expected in sentence
    placed = buffer.placed("base", ROOTS, NOW_NS, 1.0)
    assert not isinstance(placed, str)
    assert placed.pose == good


def test_an_overtaken_transform_does_not_replace_a_newer_one() -> None:
    buffer = filled(link("world", "base", Pose((1.0, 0.0, 0.0), rotation.IDENTITY)))
    assert list(buffer.take(message(link("world", "base", age_s=0.5)), is_static=False)) == []
    placed = buffer.placed("base", ROOTS, NOW_NS, 1.0)
    assert not isinstance(placed, str)
    assert placed.pose.position_m == (1.0, 0.0, 0.0)


def test_wanted_frames_and_their_parents_are_found_in_bytes() -> None:
    buffer = filled(link("odom", "base"))
    buffer.placed("base", ROOTS, NOW_NS, 1.0)
    cdr = jazzy().encode("tf2_msgs/msg/TFMessage", message(link("map", "odom"), link("base2", "x")))
    assert buffer.wanted_in(cdr) == ("odom",)


@given(TURNS)
def test_yaw_is_of_the_x_axis_unless_that_is_upright(
    yaw_rad: float,
) -> None:
    turned = rotation.from_yaw(yaw_rad)
    upright = rotation.multiply(turned, rotation.from_axis_angle((0.0, 1.0, 0.0), -math.pi / 2))
    for each in (turned, upright):
        assert math.remainder(yaw(each) - yaw_rad, math.tau) == pytest.approx(0.0, abs=1e-9)
