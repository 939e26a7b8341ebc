"""Whatever ROS may send: never an exception, never a message that our bus refuses."""

import functools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.routing.conversion_state import Guest
from pointit.bridges.ros2.routing.route_types import BusOutput, ConversionContext, ConversionWarning
from pointit.bridges.ros2.routing.routes import routes
from pointit.schemas import AddPackageReply, Message, decode, encode
from pointit.schemas.topics import Topic
from tests.unit.ros2.scenes import NOW_NS, furnished, into, jazzy, server

make = jazzy().make
FLOATS = st.floats() | st.sampled_from([0.0, 1.0, -1.0, 1e6, 1e300])
FLOATS32 = st.floats(width=32)
FRAMES = st.sampled_from(["", "world", "odom", "user1/human_footprint"]) | st.text(max_size=5)


def of(kind: str, **fields: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.fixed_dictionaries(fields).map(functools.partial(made, kind))


def made(kind: str, fields: dict[str, Any]) -> Any:
    return make(kind, **fields)


def triple(kind: str) -> st.SearchStrategy[Any]:
    return of(kind, x=FLOATS, y=FLOATS, z=FLOATS)


STAMPS = of(
    "builtin_interfaces/msg/Time",
    sec=st.integers(-(2**31), 2**31 - 1) | st.just(NOW_NS // 10**9),
    nanosec=st.integers(0, 2**32 - 1),
)
HEADERS = of("std_msgs/msg/Header", stamp=STAMPS, frame_id=FRAMES)
UNIT = st.sampled_from([{"x": 0.0, "w": 1.0}, {"x": 1.0, "w": 0.0}, {"x": 0.6, "w": 0.8}])
QUATERNIONS = UNIT.map(functools.partial(made, "geometry_msgs/msg/Quaternion")) | of(
    "geometry_msgs/msg/Quaternion", x=FLOATS, y=FLOATS, z=FLOATS, w=FLOATS
)
TRANSFORMS = of(
    "geometry_msgs/msg/TransformStamped",
    header=HEADERS,
    child_frame_id=FRAMES,
    transform=of(
        "geometry_msgs/msg/Transform", translation=triple("geometry_msgs/msg/Vector3"), rotation=QUATERNIONS
    ),
)
VALUES = {
    "geometry_msgs/msg/QuaternionStamped": {"header": HEADERS, "quaternion": QUATERNIONS},
    "sensor_msgs/msg/Imu": {
        "header": HEADERS,
        "orientation": QUATERNIONS,
        "orientation_covariance": st.lists(FLOATS, min_size=9, max_size=9),
    },
    "geometry_msgs/msg/PoseStamped": {
        "header": HEADERS,
        "pose": of(
            "geometry_msgs/msg/Pose", position=triple("geometry_msgs/msg/Point"), orientation=QUATERNIONS
        ),
    },
    "tf2_msgs/msg/TFMessage": {"transforms": st.lists(TRANSFORMS, max_size=3)},
    "rosgraph_msgs/msg/Clock": {"clock": STAMPS},
    "std_msgs/msg/Bool": {"data": st.booleans()},
    "std_msgs/msg/UInt8": {"data": st.integers(0, 255)},
    "conveyor_msgs/msg/BeltCommand": {
        "name": st.lists(st.sampled_from(["*", "part_a", "strip_0"]) | st.text(max_size=5), max_size=4),
        "velocity": st.lists(FLOATS32, max_size=4),
    },
    "conveyor_msgs/msg/PUISubscription": {
        "user_name": st.sampled_from(["user1", "eve"]) | st.text(max_size=5),
        "subscribe": st.booleans(),
        "pointer_color": of("std_msgs/msg/ColorRGBA", r=FLOATS32, g=FLOATS32, b=FLOATS32, a=FLOATS32),
        "pointer_cmap": st.just("viridis") | st.text(max_size=40),
        "pointer_size": FLOATS32,
    },
    "conveyor_msgs/srv/AddPack_Request": {
        "uid": st.integers(0, 2**32 - 1),
        "kind": st.integers(0, 255),
        "belt": st.integers(0, 255),
        "position": FLOATS32,
    },
    "conveyor_msgs/srv/SetBeltSpeed_Request": {"speed": FLOATS32},
    "std_srvs/srv/Empty_Request": {},
    "led_strip_msgs/srv/SetBrightness_Request": {
        "brightness": FLOATS32,
        "channel_index_mask": st.integers(0, 255),
    },
}


def check(found: Any) -> None:
    if isinstance(found, ConversionWarning):
        assert found.sentence
        assert "\n" not in found.sentence
        assert len(found.sentence) < 300
        return
    assert isinstance(found, BusOutput)
    assert found.at.at(found.name)
    if isinstance(found.at, Topic):
        assert isinstance(found.what, Message)
        assert type(found.what) is found.at.message
    else:
        assert type(found.what) is found.at.query
    assert decode(type(found.what), encode(found.what)) == found.what


@pytest.mark.parametrize("name", [row.name for row in routes().inward])
@given(data=st.data())
def test_whatever_comes_is_taken_or_warned_of(name: str, data: st.DataObject) -> None:
    row, scene = into(name), furnished()
    scene.person("user1")
    if data.draw(st.booleans()):
        scene.guests["user1"] = Guest(is_here=True)
    for _ in range(2):
        value = make(row.type, **{field: data.draw(each) for field, each in VALUES[row.type].items()})
        now_ns = data.draw(st.sampled_from([0, NOW_NS, NOW_NS + 10**9]))
        for found in row.convert(value, "user1", scene, now_ns=now_ns, wall_ns=now_ns):
            check(found)


@pytest.mark.parametrize("name", [row.name for row in routes().served])
@given(data=st.data())
def test_whatever_is_asked_is_answered(name: str, data: st.DataObject) -> None:
    row, scene = server(name), furnished()
    kind = jazzy().request_of(row.type)
    about = ConversionContext(scene, "user1", NOW_NS, "world")
    for _ in range(2):
        request = make(kind, **{field: data.draw(each) for field, each in VALUES[kind].items()})
        check(row.asks(request, about))
        reply = data.draw(st.sampled_from([None, AddPackageReply(object_id="19-3")]))
        jazzy().encode(jazzy().response_of(row.type), row.response(request, reply, about))
