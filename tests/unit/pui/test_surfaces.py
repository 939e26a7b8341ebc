"""Kinds side by side: priority, what hides what, clouds, lamps, what cursors say of things with an area."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    Belt,
    Box,
    Cloud,
    Cylinder,
    Environment,
    Lamp,
    Plane,
    PointingRay,
    Sphere,
    Strip,
    UserPose,
)
from pointit.services.pui.cursor import NearbyLamps, PersonCursor
from pointit.services.pui.surfaces import ALL_KINDS, OPAQUE, Surfaces
from tests.support import there
from tests.unit.pui.room import EYES

FAR_WALL_M = 8.0
CLOUD = np.column_stack([np.full(400, 6.0), np.linspace(-4, 4, 400), np.full(400, 2.5)])

ROOM = Environment(
    stamp_ns=0,
    name="room",
    lamps=(Lamp(id="lamp", position_m=(5.0, 2.0, 2.0)), Lamp(id="other", position_m=(-5.0, 0.0, 1.0))),
    strips=(Strip(id="strip", line_m=((3.0, -1.0, 0.8), (3.0, 1.0, 0.8)), pixels=60),),
    belts=(Belt(id="belt", line_m=((5.0, -3.0, 0.7), (5.0, 3.0, 0.7))),),
    boxes=(Box(id="crate", center_m=(3.0, 0.0, 0.4), size_m=(0.8, 2.0, 0.8)),),
    planes=(
        Plane(id="floor", center_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)),
        Plane(id="wall", center_m=(FAR_WALL_M, 0.0, 2.0), normal=(-1.0, 0.0, 0.0), size_m=(10.0, 4.0)),
    ),
    cylinders=(Cylinder(id="column", center_m=(4.0, -4.0, 0.0), radius_m=0.3, height_m=3.0),),
    spheres=(Sphere(id="ball", center_m=(2.0, 3.0, 1.0), radius_m=0.4),),
    clouds=(Cloud(id="scan", points=400, low_m=(6.0, -4.0, 2.5), high_m=(6.0, 4.0, 2.5)),),
)


def surfaces(*kinds: Any, room: Environment = ROOM, **options: Any) -> Surfaces:
    return Surfaces(room, kinds or ALL_KINDS, clouds={"scan": CLOUD}, **options)


def towards(target: Vec3) -> Vec3:
    return vector.normalized(vector.subtract(target, EYES))


def met(on: Surfaces, target: Vec3) -> tuple[str, str] | None:
    found = on.hit_test(EYES, towards(target))
    return None if found is None else found[0]


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ((5.0, 2.0, 2.0), ("lamp", "lamp")),
        ((3.0, 0.5, 0.8), ("strip", "strip")),
        ((5.0, 2.8, 0.7), ("belt", "belt")),
        ((4.0, -4.0, 2.0), ("cylinder", "column")),
        ((2.0, 3.0, 1.0), ("sphere", "ball")),
        ((-2.0, 1.0, 0.0), ("plane", "floor")),
        ((8.0, -4.5, 3.8), ("plane", "wall")),
        ((6.0, -2.0, 2.5), ("points", "scan")),
    ],
)
def test_every_kind_can_be_pointed_at(target: Vec3, expected: tuple[str, str]) -> None:
    # narrow: nothing thin is near enough to what has an area
    assert met(surfaces(tolerance_rad=math.radians(2)), target) == expected


# priority


def test_thin_things_come_first_within_the_tolerance_unless_said_otherwise() -> None:
    beside = (3.0, 0.5, 0.9)  # above the strip: the ray goes on to the floor
    assert met(surfaces("strip", "plane", opaque=()), beside) == ("strip", "strip")
    assert met(surfaces("strip", "plane", opaque=(), tolerance_rad=0.01), beside) == ("plane", "floor")
    assert met(surfaces("strip", "plane", opaque=(), priority={"floor": 3}), beside) == ("plane", "floor")
    assert met(surfaces("strip", "plane", opaque=(), priority={"plane": 3}), beside) == ("plane", "floor")
    both = {"plane": 3, "floor": 0, "wall": 0}
    assert met(surfaces("strip", "plane", opaque=(), priority=both), beside) == ("strip", "strip")


def test_of_equal_priority_the_least_missed_counts_then_the_nearer() -> None:
    flat = {"strip": 0, "belt": 0, "lamp": 0}
    assert met(surfaces("strip", "plane", priority=flat, opaque=()), (3.0, 0.5, 0.9)) == ("plane", "floor")
    # the ray meets both, and the floor behind the strip or the crate
    assert met(surfaces("strip", "plane", priority=flat, opaque=()), (3.0, 0.5, 0.8)) == ("strip", "strip")
    assert met(surfaces("plane", "box", priority=flat), (2.6, 0.3, 0.2)) == ("box", "crate")


# occlusion

HIDDEN_M: Vec3 = (4.5, 0.0, 0.3)
"""Behind the crate."""


def hiding(at: Vec3 = HIDDEN_M, **more: Any) -> Environment:
    return Environment(
        stamp_ns=0,
        name="hiding",
        lamps=(Lamp(id="hidden", position_m=at), *more.pop("lamps", ())),
        boxes=ROOM.boxes,
        **more,
    )


def test_lamp_behind_a_crate_is_hidden_even_when_listed_first() -> None:
    room = hiding()
    assert met(surfaces("lamp", room=room, opaque=()), HIDDEN_M) == ("lamp", "hidden")
    assert met(surfaces("lamp", room=room), HIDDEN_M) is None
    assert met(surfaces("lamp", "box", room=room), HIDDEN_M) == ("box", "crate")
    close = (3.45, 0.0, 0.4)  # right behind it
    assert met(surfaces("lamp", room=hiding(close), opaque=()), close) == ("lamp", "hidden")
    assert met(surfaces("lamp", room=hiding(close)), close) is None


def test_lamp_seen_over_a_crate_is_not_hidden() -> None:
    above = (4.5, 0.0, 0.9)
    assert met(surfaces("lamp", room=hiding(above)), above) == ("lamp", "hidden")
    # nor when the ray itself meets the crate's upper edge, a little below
    assert met(surfaces("lamp", room=hiding(above)), (3.0, 0.0, 0.78)) == ("lamp", "hidden")


def test_lamp_mounted_on_a_crate_is_seen() -> None:
    for place in ((3.0, 0.5, 0.8), (2.6, 0.5, 0.4), (2.62, 0.5, 0.4), (3.3, 0.0, 0.79)):
        assert met(surfaces("lamp", room=hiding(place)), place) == ("lamp", "hidden")


@pytest.mark.parametrize(("depth_m", "is_seen"), [(0.01, True), (0.04, True), (0.06, False), (0.3, False)])
def test_lamp_is_seen_up_to_5_cm_inside_a_crate(depth_m: float, is_seen: bool) -> None:
    front = (2.6, 0.0, 0.4)
    into = vector.normalized(vector.subtract(front, EYES))
    place = vector.add(front, vector.scale(into, depth_m))
    assert (met(surfaces("lamp", room=hiding(place)), place) is not None) == is_seen


@pytest.mark.parametrize(
    ("place", "aim"),
    [
        ((3.3, 0.0, 0.79), (2.6, 0.0, 0.7)),  # just under the top, seen over the front that the ray meets
        ((3.304, 0.0, 0.696), (3.3, 0.0, 0.8)),  # under the place that the ray meets, hardly farther
    ],
)
def test_lamp_just_inside_a_crate_is_seen_beside_the_ray(place: Vec3, aim: Vec3) -> None:
    assert met(surfaces("lamp", room=hiding(place)), aim) == ("lamp", "hidden")


def test_instead_of_something_hidden_the_next_in_front_counts() -> None:
    front = Lamp(id="front", position_m=(2.0, 0.15, 1.0))
    room = hiding(lamps=(front,))
    assert met(surfaces("lamp", room=room, opaque=()), HIDDEN_M) == ("lamp", "hidden")
    assert met(surfaces("lamp", room=room), HIDDEN_M) == ("lamp", "front")


def test_strip_partly_behind_a_crate_is_hit_in_front() -> None:
    line = ((1.5, 0.3, 0.9), (4.5, 0.0, 0.3))
    room = Environment(stamp_ns=0, name="r", strips=(Strip(id="s", line_m=line, pixels=9),), boxes=ROOM.boxes)
    found = there(surfaces("strip", room=room).hit_test(EYES, towards((4.5, 0.0, 0.3))))
    assert 1.5 <= found[1].point_m[0] < 2.9
    free = there(surfaces("strip", room=room, opaque=()).hit_test(EYES, towards((4.5, 0.0, 0.3))))
    assert free[1].point_m[0] == pytest.approx(4.5, abs=1e-4)


def test_eyes_within_a_thing_see_out_of_it() -> None:
    room = Environment(
        stamp_ns=0,
        name="r",
        lamps=(Lamp(id="l", position_m=(5.0, 0.0, 1.0)),),
        cylinders=(Cylinder(id="c", center_m=(0.1, 0.0, 0.0), radius_m=0.5, height_m=3.0),),
    )
    assert met(surfaces("lamp", room=room), (5.0, 0.0, 1.0)) == ("lamp", "l")
    assert met(surfaces("cylinder", room=room), (5.0, 0.0, 1.0)) == ("cylinder", "c")


@given(st.floats(-3.1, 3.1), st.floats(-1.2, 0.5))
def test_nothing_that_is_met_is_behind_what_is_opaque(azimuth: float, elevation: float) -> None:
    direction = vector.direction(azimuth, elevation)
    found = surfaces().hit_test(EYES, direction)
    opaque = surfaces(*OPAQUE, tolerance_rad=1e-9).hit_test(EYES, direction)
    if opaque is not None:
        assert found is not None
        # what is beyond the first opaque thing that the ray meets is seen beside it: a straight way is free
        reach = vector.subtract(found[1].point_m, EYES)
        if vector.dot(direction, reach) > opaque[1].range_m + 0.06:
            way = surfaces(*OPAQUE, tolerance_rad=1e-9).hit_test(EYES, vector.normalized(reach))
            assert way is None or way[1].range_m > found[1].range_m - 0.06


# clouds


def test_two_clouds_are_told_apart_beside_a_strip() -> None:
    room = Environment(
        stamp_ns=0,
        name="scanned",
        strips=ROOM.strips,
        clouds=(
            Cloud(id="left", points=2, low_m=(4.0, 2.0, 1.0), high_m=(4.0, 2.1, 1.0)),
            Cloud(id="right", points=1, low_m=(4.0, -2.0, 1.0), high_m=(4.0, -2.0, 1.0)),
        ),
    )
    clouds = {"left": np.array([[4.0, 2.0, 1.0], [4.0, 2.1, 1.0]]), "right": np.array([[4.0, -2.0, 1.0]])}
    on = Surfaces(room, ["points", "strip"], clouds=clouds, tolerance_rad=math.radians(4.0))
    assert (met(on, (4.0, 2.1, 1.0)), met(on, (4.0, -2.1, 1.0))) == (("points", "left"), ("points", "right"))
    assert met(on, (3.0, 0.0, 0.8)) == ("strip", "strip")


def test_a_cloud_that_was_not_read_is_named() -> None:
    with pytest.raises(ValueError, match="the points of cloud 'scan' were not read"):
        Surfaces(ROOM, ["points"])


# cursors


def cursor_at(target: Vec3, on: Surfaces, **options: Any) -> Any:
    person = PersonCursor(on, **options)
    yaw_rad = 0.8
    person.set_pose(UserPose(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=yaw_rad))
    ray = PointingRay(stamp_ns=7, origin_m=EYES, direction=vector.rotate_z(towards(target), -yaw_rad))
    return person.cursor(ray)


@pytest.mark.parametrize(
    ("target", "solid", "name", "uv_m"),
    [
        ((2.6, 0.3, 0.2), "box", "crate", (0.3, -0.2)),
        ((-2.0, 1.0, 0.0), "plane", "floor", (-2.0, 1.0)),
        ((2.0, 2.6, 1.0), "sphere", "ball", (-0.4 * math.pi / 2, 0.0)),
    ],
)
def test_a_cursor_says_where_on_an_area(
    target: Vec3, solid: str, name: str, uv_m: tuple[float, float]
) -> None:
    cursor = cursor_at(target, surfaces("box", "plane", "sphere"))
    assert (cursor.surface, cursor.solid, cursor.surface_id) == ("none", solid, name)
    assert (cursor.point_m, cursor.uv_m) == (pytest.approx(target), pytest.approx(uv_m, abs=1e-6))
    assert (cursor.miss_rad, cursor.miss_m) == (0.0, 0.0)
    assert cursor.range_m == pytest.approx(math.dist(EYES, target))


@pytest.mark.parametrize(("target", "name"), [((3.0, 0.5, 0.8), "strip"), ((0.0, 3.0, 9.0), "")])
def test_every_cursor_has_its_ray_and_stamp_even_without_hits(target: Vec3, name: str) -> None:
    cursor = cursor_at(target, surfaces("strip", tolerance_rad=0.1))
    assert (cursor.stamp_ns, cursor.surface, cursor.surface_id) == (7, name or "none", name)
    assert (cursor.point_m is None) == (not name)
    assert (cursor.origin_m, cursor.direction) == (pytest.approx(EYES), pytest.approx(towards(target)))
    assert (cursor.solid, cursor.uv_m) == ("", None)


def test_lamps_near_the_ray_have_angles_and_come_nearest_first() -> None:
    fan = NearbyLamps(ROOM.lamps, math.radians(90))
    cursor = cursor_at((5.0, 1.0, 1.0), surfaces("strip"), lamps=fan)
    (lamp,) = cursor.lamps
    assert lamp.id == "lamp"
    assert lamp.miss_rad == pytest.approx(vector.angle_between(towards((5, 1, 1)), towards((5, 2, 2))))
    everything = cursor_at((5.0, 1.0, 1.0), surfaces("strip"), lamps=NearbyLamps(ROOM.lamps[::-1], math.pi))
    assert [lamp.id for lamp in everything.lamps] == ["lamp", "other"]
    assert cursor_at((5.0, 1.0, 1.0), surfaces("strip")).lamps == ()


@pytest.mark.parametrize("x_m", [1e6, -1e6])
def test_extremely_distant_pose_gives_no_impossible_cursor(x_m: float) -> None:
    person = PersonCursor(surfaces("plane"))
    person.set_pose(UserPose(stamp_ns=0, position_m=(x_m, 0.0, 1e5), yaw_rad=0.0))
    for azimuth in (0.0, math.pi):
        direction = vector.direction(azimuth, -math.radians(6))
        ray = PointingRay(stamp_ns=0, origin_m=(x_m / 1e5, 0.0, 1.6), direction=direction)
        cursor = there(person.cursor(ray))
        assert cursor.point_m is None or abs(cursor.point_m[0]) <= 1e6
