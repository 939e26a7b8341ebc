"""Services of ROS that ours answer; whatever ROS may send: never an exception, never a bad message."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import pointit.schemas as models
from pointit.bridges.ros2.routing.conversion_state import ConversionState, RosUser
from pointit.bridges.ros2.routing.names import MAX_NUMBER
from pointit.bridges.ros2.routing.route_types import (
    BusOutput,
    ConversionContext,
    ConversionWarning,
    ServiceRoute,
)
from pointit.bridges.ros2.routing.routes import routes
from pointit.schemas.topics import Topic
from tests.unit.ros2.scenes import NOW_NS, furnished, into, jazzy, objects, out, package, quaternion, server
from tests.unit.ros2.values import any_value


def request(row: ServiceRoute, **fields: Any) -> Any:
    kind = jazzy().request_of(row.type)
    return jazzy().decode(kind, jazzy().encode(kind, jazzy().make(kind, **fields)))


def response(row: ServiceRoute, value: Any) -> Any:
    kind = jazzy().response_of(row.type)
    return jazzy().decode(kind, jazzy().encode(kind, value))


def about(scene: ConversionState) -> ConversionContext:
    return ConversionContext(scene, "user1", NOW_NS, "world")


def listed(scene: ConversionState) -> list[int]:
    (value,) = out(routes(), "packages").convert(objects(), "conveyor", scene)
    return [item.uid for item in value.packages]


def test_a_package_is_added_under_the_callers_number() -> None:
    row, scene = server("add_pack"), furnished()
    scene.take("conveyor", objects(package(1)), NOW_NS)
    asked = request(row, uid=41, kind=1, belt=1)
    found = row.asks(asked, about(scene))
    assert found == BusOutput(row.request, "", models.AddPackage(kind="red", lane="part_b"))
    # it is on the conveyor before its reply comes: it waits for its number, the others do not
    scene.take("conveyor", objects(package(1), package(2)), NOW_NS)
    assert listed(scene) == [1]
    reply = models.AddPackageReply(object_id="19-2")
    assert response(row, row.response(asked, reply, about(scene))).result
    assert listed(scene) == [1, 41]


def test_a_package_that_was_refused_leaves_its_number_free() -> None:
    row, scene = server("add_pack"), furnished()
    asked = request(row, uid=41)
    kinds = [type(row.asks(each, about(scene))) for each in (asked, request(row, uid=41))]
    assert kinds == [BusOutput, ConversionWarning], "somebody is about to get it"
    assert not response(row, row.response(asked, None, about(scene))).result
    assert isinstance(row.asks(request(row, uid=41), about(scene)), BusOutput)


def test_who_is_refused_does_not_settle_for_who_is_not() -> None:
    row, scene = server("add_pack"), furnished()
    first, second = request(row, uid=41), request(row, uid=41)
    row.asks(first, about(scene))
    row.asks(second, about(scene))
    assert not row.response(second, None, about(scene)).result
    assert not scene.uids.is_settled("19-9")
    row.response(first, models.AddPackageReply(object_id="19-9"), about(scene))
    assert scene.uids.number("19-9") == 41


def test_the_number_of_a_package_that_has_left_can_be_had_again() -> None:
    row, scene = server("add_pack"), furnished()
    scene.take("conveyor", objects(package(7)), NOW_NS)
    assert listed(scene) == [7]
    scene.take("conveyor", objects(), NOW_NS)
    asked = request(row, uid=7)
    assert isinstance(row.asks(asked, about(scene)), BusOutput)
    row.response(asked, models.AddPackageReply(object_id="19-8"), about(scene))
    scene.take("conveyor", objects(package(8)), NOW_NS)
    assert listed(scene) == [7]


@pytest.mark.parametrize(
    ("name", "fields", "query", "on"),
    [
        ("set_belt_speed", {"speed": 0.5}, models.SetSpeed(speed_mps=0.5), ""),
        ("reset_pack_sim", {}, models.ResetConveyor(), ""),
        ("set_yaw_origin", {}, models.SetYawOrigin(), "user1"),
        ("set_brightness", {"brightness": 0.5}, models.SetBrightness(brightness=0.5), ""),
        ("set_brightness", {"brightness": 7.0}, models.SetBrightness(brightness=1.0), ""),
        (
            "set_brightness",
            {"brightness": 0.5, "channel_index_mask": 1},
            models.SetBrightness(brightness=0.5, strips=("0",)),
            "",
        ),
        (
            "add_pack",
            {"uid": 4, "position": 0.5},
            models.AddPackage(kind="blue", lane="part_a", position=0.5),
            "",
        ),
        ("add_pack", {"uid": 4, "position": 5e-4}, models.AddPackage(kind="blue", lane="part_a"), ""),
    ],
)
def test_requests_are_asked_of_ours(name: str, fields: dict[str, Any], query: Any, on: str) -> None:
    row, scene = server(name), furnished()
    asked = request(row, **fields)
    assert row.asks(asked, about(scene)) == BusOutput(row.request, on, query)
    for reply in (models.Done(), None):
        response(row, row.response(asked, reply, about(scene)))


@pytest.mark.parametrize(
    ("name", "fields", "told"),
    [
        ("set_belt_speed", {"speed": 6.0}, "±5 m/s"),
        ("set_brightness", {"brightness": 0.5, "channel_index_mask": 1 << 7}, "means no strip: there are"),
        ("add_pack", {"kind": 200}, "kind 200 means nothing"),
        ("add_pack", {"belt": 2}, "there is no belt 2: there are 2, counted from 0"),
        ("add_pack", {"position": 1.5}, "send 0 (start) to 1 (end)"),
        ("add_pack", {"position": -1.0}, "send 0 (start) to 1 (end)"),
        ("add_pack", {"uid": 7}, "uid 7 is taken"),
        ("add_pack", {"uid": MAX_NUMBER + 1}, "beyond"),
    ],
)
def test_requests_that_ours_cannot_grant_are_refused(name: str, fields: dict[str, Any], told: str) -> None:
    row, scene = server(name), furnished()
    scene.take("conveyor", objects(package(7)), NOW_NS)
    assert listed(scene) == [7]
    asked = request(row, **fields)
    found = row.asks(asked, about(scene))
    assert isinstance(found, ConversionWarning)
    assert told in found.sentence
    assert not getattr(response(row, row.response(asked, None, about(scene))), "result", False)


NAMES = ["", "world", "odom", "user1/human_footprint", "*", "part_a", "strip_0", "user1", "eve", "viridis"]
UNIT = st.sampled_from([(0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), (0.6, 0.0, 0.0, 0.8)])
FLOATS = st.floats() | st.sampled_from([0.0, 1.0, -1.0, 1e6, 1e300])
STAMPS = st.integers(-(2**31), 2**31 - 1) | st.just(NOW_NS // 10**9)
LIKELY = {
    "string": st.sampled_from(NAMES) | st.text(max_size=5),
    "float32": st.floats(width=32),
    "float64": FLOATS,
    "int32": STAMPS,
    "geometry_msgs/msg/Quaternion": (UNIT | st.tuples(*4 * [FLOATS])).map(quaternion),
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
        assert isinstance(found.what, models.Message)
        assert type(found.what) is found.at.message
    else:
        assert type(found.what) is found.at.query
    assert models.decode(type(found.what), models.encode(found.what)) == found.what


@pytest.mark.parametrize("name", [row.name for row in routes().inward])
@given(data=st.data())
def test_whatever_comes_is_taken_or_warned_of(name: str, data: st.DataObject) -> None:
    row, scene = into(name), furnished()
    scene.person("user1")
    if data.draw(st.booleans()):
        scene.ros_users["user1"] = RosUser(is_here=True)
    for _ in range(2):
        value = data.draw(any_value(row.type, LIKELY))
        now_ns = data.draw(st.sampled_from([0, NOW_NS, NOW_NS + 10**9]))
        for found in row.convert(value, "user1", scene, now_ns=now_ns, wall_ns=now_ns):
            check(found)


@pytest.mark.parametrize("name", [row.name for row in routes().served])
@given(data=st.data())
def test_whatever_is_asked_is_answered(name: str, data: st.DataObject) -> None:
    row, scene = server(name), furnished()
    kind = jazzy().request_of(row.type)
    for _ in range(2):
        asked = data.draw(any_value(kind, LIKELY))
        check(row.asks(asked, about(scene)))
        reply = data.draw(st.sampled_from([None, models.AddPackageReply(object_id="19-3")]))
        jazzy().encode(jazzy().response_of(row.type), row.response(asked, reply, about(scene)))
