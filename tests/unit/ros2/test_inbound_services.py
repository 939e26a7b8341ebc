"""Services of ROS that ours answer; rays and cursor subscriptions of people who have ROS nodes only."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import pointit.schemas as models
from pointit.bridges.ros2.inbound.checks import LATE_NS
from pointit.bridges.ros2.outbound.person import pointing_ray
from pointit.bridges.ros2.routing.conversion_state import ConversionState, RosUser
from pointit.bridges.ros2.routing.route_types import (
    BusOutput,
    ConversionContext,
    ConversionWarning,
    InboundRoute,
    ServiceRoute,
)
from pointit.bridges.ros2.routing.routes import routes
from pointit.bridges.ros2.routing.uids import MAX_NUMBER
from pointit.geometry import rotation, vector
from pointit.schemas import NS_PER_S, Interaction, PointingRay, UserProfile
from pointit.schemas.topics import INTERACTION, POSE, PROFILE, RAY, Topic
from tests.unit.ros2.scenes import NOW_NS, furnished, into, jazzy, objects, out, package, quaternion, server
from tests.unit.ros2.test_inbound import frame_of, output, place, said, taken, tf, warned
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
    row = server("add_pack")
    scene = furnished()
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
    row = server("add_pack")
    scene = furnished()
    asked = request(row, uid=41)
    kinds = [type(row.asks(each, about(scene))) for each in (asked, request(row, uid=41))]
    assert kinds == [BusOutput, ConversionWarning], "somebody is about to get it"
    assert not response(row, row.response(asked, None, about(scene))).result
    assert isinstance(row.asks(request(row, uid=41), about(scene)), BusOutput)


def test_refused_request_does_not_bind_the_number_of_another() -> None:
    row = server("add_pack")
    scene = furnished()
    first = request(row, uid=41)
    second = request(row, uid=41)
    row.asks(first, about(scene))
    row.asks(second, about(scene))
    assert not row.response(second, None, about(scene)).result
    assert not scene.uids.is_settled("19-9")
    row.response(first, models.AddPackageReply(object_id="19-9"), about(scene))
    assert scene.uids.number("19-9") == 41


def test_package_number_is_free_after_the_package_has_left() -> None:
    row = server("add_pack")
    scene = furnished()
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
    row = server(name)
    scene = furnished()
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
    row = server(name)
    scene = furnished()
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
def test_any_message_is_converted_or_reported(name: str, data: st.DataObject) -> None:
    row = into(name)
    scene = furnished()
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
def test_any_request_is_answered(name: str, data: st.DataObject) -> None:
    row = server(name)
    scene = furnished()
    kind = jazzy().request_of(row.type)
    for _ in range(2):
        asked = data.draw(any_value(kind, LIKELY))
        check(row.asks(asked, about(scene)))
        reply = data.draw(st.sampled_from([None, models.AddPackageReply(object_id="19-3")]))
        jazzy().encode(jazzy().response_of(row.type), row.response(asked, reply, about(scene)))


HERS = "user1/human_footprint"
EYES = (0.1, -0.2, 1.64)
make = jazzy().make
ANGLES = st.floats(-1.5, 1.5)


def with_guests(*names: str, is_here: bool = True) -> ConversionState:
    scene = furnished()
    for name in names:
        scene.ros_users[name] = RosUser(is_here=is_here)
    return scene


def wish(
    name: str = "user1",
    *,
    subscribe: bool = True,
    rgb: tuple[float, float, float] = (1.0, 0.5, 0.0),
    cmap: str = "viridis",
    size_m: float = 0.25,
) -> Any:
    red, green, blue = rgb
    return make(
        "conveyor_msgs/msg/PUISubscription",
        user_name=name,
        subscribe=subscribe,
        pointer_color=make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
        pointer_cmap=cmap,
        pointer_size=size_m,
    )


def foreign(row: InboundRoute, value: Any, scene: ConversionState) -> list[BusOutput | ConversionWarning]:
    """Messages from a value that our own codec would not send."""
    return list(row.convert(value, "user1", scene, now_ns=NOW_NS, wall_ns=NOW_NS))


def whats(found: list[BusOutput | ConversionWarning]) -> list[Any]:
    return [each.what if isinstance(each, BusOutput) else each.sentence for each in found]


def test_a_ray_begins_at_the_eyes_and_goes_along_x() -> None:
    row = into("pointing_ray_in")
    scene = with_guests("user1")
    value = place(at=EYES, frame=HERS)
    one = output(taken(row, value, scene))
    assert (one.at, one.name) == (RAY, "user1")
    assert (one.what.stamp_ns, one.what.origin_m, one.what.raw_direction) == (NOW_NS, EYES, None)
    assert one.what.direction == pytest.approx((math.cos(1.0), math.sin(1.0), 0.0))
    assert scene.ros_users["user1"].has_new_input


@given(azimuth_rad=ANGLES, elevation_rad=ANGLES, roll_rad=ANGLES, factor=st.sampled_from([1.0, -1.0, 1.0004]))
def test_ray_has_unit_length_and_converts_back(
    azimuth_rad: float, elevation_rad: float, roll_rad: float, factor: float
) -> None:
    row = into("pointing_ray_in")
    scene = with_guests("user1")
    way = vector.direction(azimuth_rad, elevation_rad)
    ours = PointingRay(stamp_ns=NOW_NS, seq=1, origin_m=EYES, direction=way)
    (value,) = pointing_ray(ours, ConversionContext(scene, "user1", NOW_NS, HERS))
    rolled = rotation.from_azimuth_elevation(azimuth_rad, elevation_rad, roll_rad)
    x, y, z, w = (factor * each for each in rolled)
    for each in (value.pose.orientation, quaternion((x, y, z, w))):
        value.pose.orientation = each
        found = said(taken(row, value, scene))
        assert math.hypot(*found.direction) == pytest.approx(1.0, abs=1e-9)
        assert found.direction == pytest.approx(way, abs=1e-6)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (place(frame="world"), "is in the frame 'world': send it in 'user1/human_footprint'"),
        (place(q=(0.0, 0.0, 0.0, 0.0), frame=HERS), "the norm of its quaternion is 0"),
        (place(q=(math.nan, 0.0, 0.0, 1.0), frame=HERS), "the norm of its quaternion is nan"),
        (place(at=(0.0, math.nan, 0.0), frame=HERS), "is not a position"),
    ],
)
def test_invalid_ray_is_reported_and_makes_nobody_present(value: Any, told: str) -> None:
    scene = with_guests("user1")
    sentence = warned(foreign(into("pointing_ray_in"), value, scene))
    assert told in sentence
    assert "the ray of user1" in sentence
    assert not scene.ros_users["user1"].has_new_input


def test_ray_of_another_clock_is_stamped_now_and_reported() -> None:
    value = place(at=EYES, frame=HERS)
    value.header.stamp.sec = (NOW_NS - 2 * LATE_NS) // NS_PER_S
    first, second = taken(into("pointing_ray_in"), value, with_guests("user1"))
    assert said([first]).stamp_ns == NOW_NS
    assert "behind the site's clock" in warned([second])


def test_first_rays_make_ros_users_present_and_others_are_ignored() -> None:
    row = into("pointing_ray_in")
    scene = with_guests("user1", is_here=False)
    assert taken(row, place(frame=HERS), scene) == []
    assert scene.ros_users["user1"].has_new_input
    scene.ros_users["user1"].is_here = True
    assert isinstance(said(taken(row, place(frame=HERS), scene)), PointingRay)
    assert taken(row, place(frame=HERS), with_guests("user2")) == []
    assert taken(row, place(frame="nonsense")) == []


def test_subscription_starts_and_ends_pointing_with_its_cursor() -> None:
    row = into("subscription_in")
    scene = with_guests("user1", "user2", "anna-2")
    look, points = (output([each]) for each in taken(row, wish(), scene))
    assert (look.at, look.name, points.at, points.name) == (PROFILE, "user1", INTERACTION, "user1")
    assert look.what.cursor_color == (255, 128, 0)
    assert (look.what.cursor_colormap, look.what.cursor_width_m) == ("viridis", 0.25)
    assert points.what.state == "pointing"
    assert scene.ros_users["user1"] == RosUser(is_here=True, has_new_input=True, is_subscribed=True)
    assert scene.ros_users["user2"] == RosUser(is_here=True)
    assert said(taken(row, wish(subscribe=False), scene)).state == "idle"
    assert not scene.ros_users["user1"].is_subscribed
    look, points = (output([each]) for each in taken(row, wish("anna_2", rgb=(-1.0, 7.0, 1.0)), scene))
    assert points.name == "anna-2", "known by their name in ROS"
    assert look.what.cursor_color == (0, 255, 255), "the nearest"


def test_repeated_subscription_is_dropped_unless_the_cursor_changes() -> None:
    row = into("subscription_in")
    scene = with_guests("user1")
    assert taken(row, wish(subscribe=False), scene) == []
    assert len(taken(row, wish(), scene)) == 2
    assert taken(row, wish(), scene) == []
    assert said(taken(row, wish(size_m=0.5), scene)).cursor_width_m == 0.5
    assert said(taken(row, wish(subscribe=False), scene)).state == "idle"
    assert taken(row, wish(subscribe=False), scene) == []
    assert [type(each) for each in whats(taken(row, wish(size_m=0.5), scene))] == [UserProfile, Interaction]


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (wish(rgb=(math.nan, 0.0, 0.0)), "send r, g and b from 0 to 1"),
        (wish(size_m=0.0), "is to be 0 m wide: send up to 1"),
        (wish(size_m=1.5), "is to be 1.5 m wide"),
        (wish(size_m=math.inf), "is to be inf m wide"),
        (wish(cmap="x" * 40), "there is no colormap 'xxx"),
    ],
)
def test_invalid_cursor_appearance_is_reported_and_pointing_starts(value: Any, told: str) -> None:
    sentence, points = whats(foreign(into("subscription_in"), value, with_guests("user1")))
    assert told in sentence
    assert points.state == "pointing"


def test_subscription_of_strangers_is_reported_and_of_pointit_users_ignored() -> None:
    row = into("subscription_in")
    scene = with_guests("user1")
    sentence = warned(taken(row, wish("eve"), scene))
    assert sentence.startswith("'eve' wants a cursor, but is unknown here: list ")
    assert "`people`" in sentence
    assert taken(row, wish("eve", subscribe=False), scene) == []
    scene.person("ben")
    assert taken(row, wish("ben"), scene) == []
    assert warned(taken(row, wish("x" * 500), scene))[:3] == "'xx"


def test_static_frame_of_a_ros_user_is_their_pose() -> None:
    row = into("tf_static_in")
    scene = with_guests("user1")
    assert taken(row, tf(frame_of(HERS)), scene) == []
    assert row.on_presence is not None
    scene.person("user1")
    early = row.on_presence(ConversionContext(scene, "user1", NOW_NS, "world"))
    for pose in (output([*early]), output(taken(row, tf(frame_of(HERS)), scene))):
        assert (pose.at, pose.name) == (POSE, "user1")
        assert (pose.what.position_m, pose.what.method) == ((1.0, 2.0, 0.0), "external")
        assert pose.what.yaw_rad == pytest.approx(1.0)
    assert scene.person("user1").tf_until_ns > NOW_NS + 3600 * NS_PER_S
