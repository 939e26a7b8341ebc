"""Lines of several points, and solids."""

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry import polyline, vector
from pointit.geometry.floor_area import FloorArea, Vec2, point_segment_m
from pointit.geometry.polyline import Polyline
from pointit.geometry.ray_cast import SolidCaster
from pointit.geometry.solids import (
    MAX_EYES,
    BoxSolid,
    CylinderSolid,
    PlaneSolid,
    Solid,
    SphereSolid,
    plane_axes,
)
from pointit.geometry.vector import Vec3
from tests.support import there
from tests.unit.geometry.test_cloud_tree import misses
from tests.unit.geometry.test_ray_cast import some_direction

Array = NDArray[np.float64]

FORMS = ["box", "sphere", "cylinder", "plane"]
seeds = st.integers(0, 2**32 - 1)
forms = st.sampled_from(FORMS)
GRID = 80


def some_point(rng: random.Random, size_m: float = 4.0) -> Vec3:
    return (rng.uniform(-size_m, size_m), rng.uniform(-size_m, size_m), rng.uniform(-size_m, size_m))


def turned(points: Array, yaw: float) -> Array:
    c = math.cos(yaw)
    s = math.sin(yaw)
    return np.asarray(points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


def square(count: int, across: int) -> Array:
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, count), np.linspace(-0.5, 0.5, across))
    return np.column_stack([u.ravel(), v.ravel()])


def box_skin(size: Vec3) -> Array:
    """Return points of the faces, and more of the edges: the closest point of a missed box is on one."""
    uv = np.concatenate([square(20, 20), square(2 * GRID, 2), square(2, 2 * GRID)])
    faces = [np.insert(uv, axis, side, axis=1) for axis in range(3) for side in (-0.5, 0.5)]
    return np.asarray(np.concatenate(faces) * np.array(size))


def ball_skin(radius: float) -> Array:
    a, e = (x.ravel() for x in np.meshgrid(np.linspace(-np.pi, np.pi, 160), np.linspace(-1.5708, 1.5708, 80)))
    return np.asarray(radius * np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]))


def cylinder_skin(radius: float, height: float) -> Array:
    a, t = (x.ravel() for x in np.meshgrid(np.linspace(-np.pi, np.pi, 160), np.linspace(0.0, 1.0, 80)))
    side = np.column_stack([radius * np.cos(a), radius * np.sin(a), height * t])
    end = np.column_stack([radius * t * np.cos(a), radius * t * np.sin(a), np.zeros(len(a))])
    return np.concatenate([side, end, end + np.array([0.0, 0.0, height])])


def some_solid(rng: random.Random, form: str) -> tuple[Solid, Array]:
    """Return a solid and many points of its skin."""
    at = some_point(rng, 2.0)
    size = (rng.uniform(0.1, 2), rng.uniform(0.1, 2), rng.uniform(0.1, 2))
    if form == "box":
        yaw = rng.uniform(-3, 3)
        return BoxSolid(at, size, yaw), turned(box_skin(size), yaw) + np.array(at)
    if form == "sphere":
        return SphereSolid(at, size[0]), ball_skin(size[0]) + np.array(at)
    if form == "cylinder":
        return CylinderSolid(at, size[0], size[1]), cylinder_skin(size[0], size[1]) + np.array(at)
    normal = some_direction(rng)
    u, v = plane_axes(normal)
    grid = square(GRID, GRID) * size[:2]
    points = grid[:, :1] * np.array(u) + grid[:, 1:] * np.array(v) + np.array(at)
    return PlaneSolid(at, normal, (size[0], size[1]), grazing_rad=0.0), points


@settings(max_examples=150)
@given(seeds, forms)
def test_no_point_of_the_skin_is_missed_by_less(seed: int, form: str) -> None:
    rng = random.Random(seed)
    solid, skin = some_solid(rng, form)
    origin = some_point(rng)
    near = vector.subtract(some_point(rng, 3.0), origin)
    direction = vector.normalized(near) if rng.random() < 0.7 else some_direction(rng)
    hit = there(SolidCaster([solid]).cast(origin, direction))
    least = misses(skin, origin, direction).min()

    assert hit.miss_rad <= least + 1e-7
    # and it is a point of the skin
    inwards = vector.scale(vector.subtract(solid.bounding_sphere[0], hit.point_m), 1e-5)
    if form == "plane":
        assert np.linalg.norm(skin - np.array(hit.point_m), axis=1).min() < 0.03
    else:
        assert solid.contains(vector.add(hit.point_m, inwards))
        assert not solid.contains(vector.subtract(hit.point_m, inwards))


@settings(max_examples=20)
@given(seeds)
def test_box_is_passed_at_its_outline_from_returning_eyes(seed: int) -> None:
    rng = random.Random(seed)
    solid, skin = some_solid(rng, "box")
    assert isinstance(solid, BoxSolid)
    eyes = [some_point(rng) for _ in range(MAX_EYES + 1)]
    for origin in (*eyes, *eyes[:3]):
        for direction in (some_direction(rng), vector.normalized(vector.subtract(some_point(rng), origin))):
            passed = solid.passed_at(origin, direction)
            assert (passed is None) == (solid.intersect(origin, direction) is not None)
            if passed is not None:
                miss = vector.angle_between(direction, vector.subtract(passed, origin))
                assert miss <= misses(skin, origin, direction).min() + 1e-7
                assert solid.closest_approach(origin, direction) == pytest.approx(passed)


@given(seeds, forms)
def test_ray_to_an_inner_point_intersects_there_or_before(seed: int, form: str) -> None:
    rng = random.Random(seed)
    solid, skin = some_solid(rng, form)
    origin = some_point(rng)
    x, y, z = skin[rng.randrange(len(skin))].tolist()
    target = vector.add((x, y, z), vector.scale(vector.subtract(solid.bounding_sphere[0], (x, y, z)), 1e-3))
    reach = vector.subtract(target, origin)
    ahead = there(solid.intersect(origin, vector.normalized(reach)))
    assert ahead <= vector.norm(reach) + 1e-6 or solid.contains(origin)


@given(seeds, forms)
def test_intersection_is_on_the_surface_with_nothing_before(seed: int, form: str) -> None:
    rng = random.Random(seed)
    solid, _ = some_solid(rng, form)
    origin = some_point(rng)
    direction = vector.normalized(vector.subtract(some_point(rng, 2.5), origin))
    ahead = solid.intersect(origin, direction)
    if ahead is None:
        return

    assert ahead >= 0.0
    within = solid.contains(origin)
    steps = [ahead * i / 50 for i in range(1, 50)]
    inside = [solid.contains(vector.add(origin, vector.scale(direction, step))) for step in steps]
    assert all(inside) if within else not any(inside)

    if form != "plane":
        before = solid.contains(vector.add(origin, vector.scale(direction, ahead - 1e-6)))
        after = solid.contains(vector.add(origin, vector.scale(direction, ahead + 1e-6)))
        assert before is within or ahead < 1e-5
        assert not (before and after)


@pytest.mark.parametrize("form", FORMS)
def test_solids_behind_are_not_intersected(form: str) -> None:
    solid: dict[str, Solid] = {
        "box": BoxSolid((-3.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
        "sphere": SphereSolid((-3.0, 0.0, 0.0), 1.0),
        "cylinder": CylinderSolid((-3.0, 0.0, -1.0), 1.0, 2.0),
        "plane": PlaneSolid((-3.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0)),
    }
    assert solid[form].intersect((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)) is None
    assert solid[form].intersect((-9.0, 0.0, 0.0), (1.0, 0.0, 0.0)) is not None
    assert SolidCaster([solid[form]]).cast((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.5) is None


# places


def test_places_on_a_box() -> None:
    box = BoxSolid((1.0, 2.0, 3.0), (2.0, 4.0, 6.0), math.pi / 2)
    assert box.uv_at((1.0, 2.5, 6.0)) == pytest.approx((0.5, 0.0))  # on top: its x axis points along y
    assert box.uv_at((1.5, 3.0, 4.0)) == pytest.approx((-0.5, 1.0))  # across its x axis: (y, z)
    assert box.uv_at((3.0, 2.5, 4.0)) == pytest.approx((0.5, 1.0))  # across its y axis: (x, z)


def test_places_on_balls_and_cylinders() -> None:
    ball = SphereSolid((1.0, 0.0, 0.0), 2.0)
    assert ball.uv_at((1.0, 2.0, 0.0)) == pytest.approx((math.pi, 0.0))
    assert ball.uv_at((1.0, 0.0, 2.0))[1] == pytest.approx(math.pi)
    tank = CylinderSolid((1.0, 0.0, 0.5), 2.0, 3.0)
    assert tank.uv_at((1.0, 2.0, 1.5)) == pytest.approx((math.pi, 1.0))
    assert tank.uv_at((2.0, 0.5, 3.5)) == pytest.approx((1.0, 0.5))


@given(seeds)
def test_the_axes_of_a_plane(seed: int) -> None:
    normal = some_direction(random.Random(seed))
    u, v = plane_axes(normal)
    assert [vector.norm(u), vector.norm(v)] == pytest.approx([1.0, 1.0])
    assert [vector.dot(u, v), vector.dot(u, normal), vector.dot(v, normal)] == pytest.approx(
        [0.0] * 3, abs=1e-9
    )
    assert vector.dot(vector.cross(u, v), normal) == pytest.approx(1.0)
    # nothing in the plane rises more than v
    assert v[2] == pytest.approx(math.hypot(normal[0], normal[1]))


def test_the_axes_of_level_and_upright_planes() -> None:
    assert plane_axes((0.0, 0.0, 1.0)) == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert plane_axes((0.0, 0.0, -1.0)) == ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert plane_axes((1.0, 0.0, 0.0)) == ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


# planes


@pytest.mark.parametrize("size", [None, (100.0, 100.0)])
@pytest.mark.parametrize(("angle_deg", "met"), [(5.2, True), (4.8, False), (-4.8, False), (-5.2, True)])
def test_grazing_planes_are_refused(size: tuple[float, float] | None, angle_deg: float, met: bool) -> None:
    floor = PlaneSolid((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), size)
    eyes = (0.0, 0.0, 1.64 if angle_deg > 0 else -1.64)  # from both sides
    down = vector.direction(0.3, -math.radians(angle_deg))
    assert (SolidCaster([floor]).cast(eyes, down, 0.2) is not None) is met


def test_a_plane_without_end_is_met_or_not_there() -> None:
    wall = PlaneSolid((0.0, 5.0, 0.0), (0.0, -1.0, 0.0))
    hit = there(SolidCaster([wall]).cast((1.0, 0.0, 1.5), (0.0, 1.0, 0.0), 0.1))
    assert hit.point_m == pytest.approx((1.0, 5.0, 1.5))
    assert hit.uv_m == pytest.approx((1.0, 1.5))
    assert SolidCaster([wall]).cast((1.0, 0.0, 1.5), (0.0, -1.0, 0.0), 3.0) is None


# many


@given(seeds, st.integers(1, 15), st.floats(0.02, 1.0))
def test_the_first_met_or_else_the_closest(seed: int, count: int, tolerance: float) -> None:
    rng = random.Random(seed)
    solids = [some_solid(rng, rng.choice(["box", "sphere", "plane"]))[0] for _ in range(count)]
    origin = some_point(rng)
    direction = vector.normalized(vector.subtract(some_point(rng, 2.5), origin))
    alone = [SolidCaster([solid]).cast(origin, direction, tolerance) for solid in solids]
    hit = SolidCaster(solids).cast(origin, direction, tolerance)
    known = [(h.miss_rad, h.range_m) for h in alone if h is not None]
    assert (hit is not None) == bool(known)
    if hit is not None:
        assert hit.miss_rad == pytest.approx(min(known)[0], abs=2e-9)
        if hit.miss_rad == 0.0:
            assert hit.range_m == min(known)[1]
        assert solids[hit.target].uv_at(hit.point_m) == hit.uv_m


@given(seeds, st.integers(1, 15))
def test_first_hit_is_the_nearest_solid_met_from_outside(seed: int, count: int) -> None:
    rng = random.Random(seed)
    solids = [some_solid(rng, rng.choice(["box", "sphere", "cylinder"]))[0] for _ in range(count)]
    origin = some_point(rng)
    direction = vector.normalized(vector.subtract(some_point(rng, 2.5), origin))
    met = [s.intersect(origin, direction) for s in solids if not s.contains(origin)]
    expected = min([ahead for ahead in met if ahead is not None], default=math.inf)
    assert SolidCaster(solids).first_hit_m(origin, direction) == pytest.approx(expected)


def test_beyond_the_reach_a_nearer_one_that_is_missed_counts() -> None:
    far = SphereSolid((9.0, 0.0, 0.0), 1.0)
    aside = SphereSolid((3.0, 0.8, 0.0), 0.5)
    caster = SolidCaster([far, aside])
    met, passed = (caster.cast((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.3, reach) for reach in (math.inf, 5.0))
    assert met is not None
    assert passed is not None
    assert (met.target, met.miss_rad, passed.target) == (0, 0.0, 1)
    assert passed.miss_rad == pytest.approx(math.atan2(0.8, 3.0) - math.asin(0.5 / math.hypot(0.8, 3.0)))
    assert caster.cast((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.3, 1.0) is None


@pytest.mark.parametrize("form", ["box", "sphere", "cylinder"])
def test_ray_from_inside_intersects_the_wall_from_within(form: str) -> None:
    solid: dict[str, Solid] = {
        "box": BoxSolid((0.0, 0.0, 0.0), (4.0, 4.0, 4.0)),
        "sphere": SphereSolid((0.0, 0.0, 0.0), 2.0),
        "cylinder": CylinderSolid((0.0, 0.0, -2.0), 2.0, 4.0),
    }
    for azimuth in (0.0, math.pi / 2, math.pi, -math.pi / 2):
        hit = there(SolidCaster([solid[form]]).cast((0.0, 0.0, 0.0), vector.direction(azimuth, 0.0)))
        assert hit.range_m == pytest.approx(2.0)


places = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@pytest.mark.parametrize("far_m", [1.1e6, 1e308, -1e308, math.inf, math.nan])
def test_a_line_beyond_the_world_is_refused(far_m: float) -> None:
    with pytest.raises(ValueError, match="within 1e\\+06 m"):
        Polyline(((0.0, 0.0, 0.0), (far_m, 0.0, 0.0)))


@pytest.mark.parametrize("step_m", [0.0, 5e-324, 1e-200, 1e-10])
def test_a_line_without_length_is_refused(step_m: float) -> None:
    with pytest.raises(ValueError, match="two different vertices"):
        Polyline(((1.0, 0.0, 0.0), (1.0 + step_m, step_m, 0.0)))


def test_repeated_vertices_are_dropped() -> None:
    line = Polyline(((0.0, 0.0, 0.0), (0.0, 5e-324, 0.0), (2.0, 0.0, 0.0), (2.0, 0.0, 0.0)))
    assert (line.length_m, line.tangent_at(1.0)) == (2.0, (1.0, 0.0, 0.0))


@given(st.lists(places, min_size=2, max_size=6, unique=True), st.lists(places, min_size=1, max_size=5))
def test_no_sample_of_the_line_is_nearer_than_the_nearest(
    vertices_m: list[tuple[float, float, float]], points_m: list[tuple[float, float, float]]
) -> None:
    try:
        line = Polyline(vertices_m)
    except ValueError:
        return
    positions_m, apart_m = line.nearest_to(np.array(points_m))
    feet_m = line.points_at(positions_m)
    assert np.linalg.norm(feet_m - points_m, axis=1) == pytest.approx(apart_m, abs=1e-9)
    samples_m = line.points_at(np.linspace(0.0, line.length_m, 200))
    gaps_m = np.linalg.norm(samples_m[None] - np.array(points_m)[:, None], axis=2).min(axis=1)
    assert (apart_m <= gaps_m + 1e-9).all()


def test_many_points_at_once_are_taken_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Polyline(((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 2.0, 0.0)))
    points_m = np.column_stack([np.linspace(-1.0, 3.0, 31), np.linspace(2.0, -1.0, 31), np.ones(31)])
    whole = line.nearest_to(points_m)
    monkeypatch.setattr(polyline, "AT_ONCE", 8)
    for parts, all_at_once in zip(line.nearest_to(points_m), whole, strict=True):
        assert parts.tolist() == all_at_once.tolist()


@given(st.floats(0.01, 0.3), st.floats(1.0, 3.0), st.floats(0.01, 0.5))
def test_points_past_an_end_are_beyond_it(first_m: float, second_m: float, past_m: float) -> None:
    line = Polyline(((0.0, 0.0, 0.0), (first_m, 0.0, 0.0), (first_m, second_m, 0.0)))
    points_m = np.array(
        [(-past_m, 0.0, 0.0), (0.0, 0.1, 0.0), (first_m, second_m, 0.2), (first_m, second_m + past_m, 0.0)]
    )
    positions_m, _ = line.nearest_to(points_m)
    assert line.is_beyond_ends(points_m, positions_m).tolist() == [True, False, False, True]
    assert not line.is_beyond_ends(points_m, positions_m, past_m + 1e-6).any()


coordinate = st.floats(-4.0, 4.0).map(lambda value: round(value, 3))
point = st.tuples(coordinate, coordinate)
L_SHAPE = FloorArea([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)])


@st.composite
def stars(draw: st.DrawFn) -> FloorArea:
    """Polygons around the origin whose corners have rising azimuths, which never cross themselves."""
    count = draw(st.integers(3, 8))
    radii = draw(st.lists(st.floats(0.5, 3.0), min_size=count, max_size=count))
    return FloorArea(
        [
            (radius * math.cos(math.tau * index / count), radius * math.sin(math.tau * index / count))
            for index, radius in enumerate(radii)
        ]
    )


def sampled(start: Vec2, end: Vec2, count: int = 200) -> list[Vec2]:
    return [
        (start[0] + t / count * (end[0] - start[0]), start[1] + t / count * (end[1] - start[1]))
        for t in range(count + 1)
    ]


def test_a_corner_that_points_inwards_is_outside() -> None:
    assert L_SHAPE.contains((0.5, 2.5))
    assert not L_SHAPE.contains((2.0, 2.0))
    assert L_SHAPE.signed_distance_m((2.0, 2.0)) == pytest.approx(1.0)
    assert L_SHAPE.signed_distance_m((0.5, 0.5)) == pytest.approx(-0.5)
    assert L_SHAPE.nearest((2.0, 1.5)) == (2.0, 1.0)
    assert L_SHAPE.area_m2 == pytest.approx(5.0)


@given(stars(), point, point)
def test_distance_of_a_segment_is_that_of_its_nearest_point(shape: FloorArea, start: Vec2, end: Vec2) -> None:
    least = min(min(point_segment_m(each, a, b) for a, b in shape.edges_m) for each in sampled(start, end))
    assert not shape.is_apart(start, end, least + 1e-9)
    assert shape.is_apart(start, end, max(least - math.dist(start, end) / 200, 0.0))


@given(stars(), point)
def test_the_nearest_point_is_on_the_outline_at_the_distance(shape: FloorArea, place: Vec2) -> None:
    nearest = shape.nearest(place)
    assert abs(shape.signed_distance_m(nearest)) < 1e-9
    assert abs(shape.signed_distance_m(place)) == pytest.approx(math.dist(nearest, place))


@given(stars())
def test_a_star_does_not_cross_itself(shape: FloorArea) -> None:
    assert shape.crossing() is None


@pytest.mark.parametrize(
    ("outline", "edges"),
    [([(0, 0), (2, 2), (2, 0), (0, 2)], (0, 2)), ([(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)], (0, 2))],
)
def test_an_outline_that_meets_itself_is_found(outline: list[Vec2], edges: tuple[int, int]) -> None:
    assert FloorArea(outline).crossing() == edges
