"""Services of ROS that ours answer."""

from typing import Any

import pytest

from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import (
    BusOutput,
    ConversionContext,
    ConversionWarning,
    ServiceRoute,
)
from pointit.bridges.ros2.routing.routes import routes
from pointit.bridges.ros2.routing.uids import MAX_NUMBER
from pointit.schemas import (
    AddPackage,
    AddPackageReply,
    Done,
    ResetConveyor,
    SetBrightness,
    SetSpeed,
    SetYawOrigin,
)
from tests.unit.ros2.scenes import NOW_NS, furnished, jazzy, objects, out, package, server


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
    assert found == BusOutput(row.request, "", AddPackage(kind="red", lane="part_b"))
    # it is on the conveyor before its reply comes: it waits for its number, the others do not
    scene.take("conveyor", objects(package(1), package(2)), NOW_NS)
    assert listed(scene) == [1]
    reply = AddPackageReply(object_id="19-2")
    assert response(row, row.response(asked, reply, about(scene))).result
    assert listed(scene) == [1, 41]


def test_a_package_that_was_refused_leaves_its_number_free() -> None:
    row, scene = server("add_pack"), furnished()
    asked = request(row, uid=41)
    assert isinstance(row.asks(asked, about(scene)), BusOutput)
    assert isinstance(
        row.asks(request(row, uid=41), about(scene)), ConversionWarning
    )  # somebody is about to get it
    assert not response(row, row.response(asked, None, about(scene))).result
    assert isinstance(row.asks(request(row, uid=41), about(scene)), BusOutput)


def test_who_is_refused_does_not_settle_for_who_is_not() -> None:
    row, scene = server("add_pack"), furnished()
    first, second = request(row, uid=41), request(row, uid=41)
    row.asks(first, about(scene))
    row.asks(second, about(scene))
    assert not row.response(second, None, about(scene)).result
    assert not scene.uids.is_settled("19-9")
    row.response(first, AddPackageReply(object_id="19-9"), about(scene))
    assert scene.uids.number("19-9") == 41


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"kind": 200}, "kind 200 means nothing"),
        ({"belt": 2}, "there is no belt 2: there are 2, counted from 0"),
        ({"position": 1.5}, "send 0 (start) to 1 (end)"),
        ({"position": -1.0}, "send 0 (start) to 1 (end)"),
        ({"uid": 7}, "uid 7 is taken"),
        ({"uid": MAX_NUMBER + 1}, "beyond"),
    ],
)
def test_a_package_that_cannot_be_is_refused(fields: dict[str, Any], told: str) -> None:
    row, scene = server("add_pack"), furnished()
    scene.take("conveyor", objects(package(7)), NOW_NS)
    assert listed(scene) == [7]
    asked = request(row, **fields)
    found = row.asks(asked, about(scene))
    assert isinstance(found, ConversionWarning)
    assert told in found.sentence
    assert not response(row, row.response(asked, None, about(scene))).result


def test_the_number_of_a_package_that_has_left_can_be_had_again() -> None:
    row, scene = server("add_pack"), furnished()
    scene.take("conveyor", objects(package(7)), NOW_NS)
    assert listed(scene) == [7]
    scene.take("conveyor", objects(), NOW_NS)
    asked = request(row, uid=7)
    assert isinstance(row.asks(asked, about(scene)), BusOutput)
    row.response(asked, AddPackageReply(object_id="19-8"), about(scene))
    scene.take("conveyor", objects(package(8)), NOW_NS)
    assert listed(scene) == [7]


@pytest.mark.parametrize(
    ("name", "fields", "query", "on"),
    [
        ("set_belt_speed", {"speed": 0.5}, SetSpeed(speed_mps=0.5), ""),
        ("reset_pack_sim", {}, ResetConveyor(), ""),
        ("set_yaw_origin", {}, SetYawOrigin(), "user1"),
        ("set_brightness", {"brightness": 0.5}, SetBrightness(brightness=0.5), ""),
        ("set_brightness", {"brightness": 7.0}, SetBrightness(brightness=1.0), ""),
        (
            "set_brightness",
            {"brightness": 0.5, "channel_index_mask": 1},
            SetBrightness(brightness=0.5, strips=("0",)),
            "",
        ),
        ("add_pack", {"uid": 4, "position": 0.5}, AddPackage(kind="blue", lane="part_a", position=0.5), ""),
        ("add_pack", {"uid": 4, "position": 5e-4}, AddPackage(kind="blue", lane="part_a"), ""),
    ],
)
def test_requests_are_asked_of_ours(name: str, fields: dict[str, Any], query: Any, on: str) -> None:
    row, scene = server(name), furnished()
    asked = request(row, **fields)
    assert row.asks(asked, about(scene)) == BusOutput(row.request, on, query)
    for reply in (Done(), None):
        response(row, row.response(asked, reply, about(scene)))


@pytest.mark.parametrize(
    ("name", "fields", "told"),
    [
        ("set_belt_speed", {"speed": 6.0}, "±5 m/s"),
        ("set_brightness", {"brightness": 0.5, "channel_index_mask": 1 << 7}, "means no strip: there are"),
    ],
)
def test_requests_that_ours_cannot_grant_are_refused(name: str, fields: dict[str, Any], told: str) -> None:
    row = server(name)
    found = row.asks(request(row, **fields), about(furnished()))
    assert isinstance(found, ConversionWarning)
    assert told in found.sentence
