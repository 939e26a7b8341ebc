"""One segment and one ray by closed forms; many targets: arrays against each alone, rigid motions."""

import math
import random
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline, make_hit, nearest_in_angle
from pointit.geometry.ray_cast import FEW, RayCaster
from pointit.geometry.vector import Vec3
from tests.support import there

seeds = st.integers(0, 2**32 - 1)


def some_point(rng: random.Random, size_m: float = 5.0) -> Vec3:
    return (rng.uniform(-size_m, size_m), rng.uniform(-size_m, size_m), rng.uniform(-size_m, size_m))


def some_direction(rng: random.Random) -> Vec3:
    return vector.direction(rng.uniform(-math.pi, math.pi), rng.uniform(-1.5, 1.5))


def curve(rng: random.Random, count: int, step_m: float = 0.02) -> Polyline:
    """Return a smooth line of many short segments."""
    at = some_point(rng)
    heading = rng.uniform(-3, 3)
    vertices = [at]
    for _ in range(count):
        heading += rng.gauss(0, 0.05)
        at = vector.add(at, (step_m * math.cos(heading), step_m * math.sin(heading), 0.0))
        vertices.append(at)
    return Polyline(vertices)


def scene(rng: random.Random) -> tuple[list[Polyline], list[Vec3]]:
    lines = [Polyline([some_point(rng), some_point(rng)]) for _ in range(rng.randint(1, 4))]
    lines += [curve(rng, rng.randint(1, 120)) for _ in range(rng.randint(1, 3))]
    return lines, [some_point(rng) for _ in range(rng.randint(FEW, FEW + 3))]


def least(lines: list[Polyline], points: list[Vec3], o: Vec3, d: Vec3) -> float:
    """Return the least miss of all segments, each on its own."""
    ends = [(p, p) for p in points]
    for line in lines:
        vertices = [(v[0], v[1], v[2]) for v in line.vertices_m.tolist()]
        ends += list(pairwise(vertices))
    misses: list[float] = []
    for start, end in ends:
        span = vector.subtract(end, start)
        t, _ = nearest_in_angle(vector.subtract(start, o), span, d)
        misses.append(make_hit(0, 0.0, vector.add(start, vector.scale(span, t)), o, d).miss_rad)
    return min(misses)


@given(seeds)
def test_no_segment_is_overlooked(seed: int) -> None:
    rng = random.Random(seed)
    lines, points = scene(rng)
    o = some_point(rng)
    d = some_direction(rng)
    hit = there(RayCaster(lines, points).cast(o, d))
    assert hit.miss_rad == pytest.approx(least(lines, points, o, d), abs=3e-7)


@given(seeds)
def test_ray_hit_is_on_its_target_with_its_true_misses(seed: int) -> None:
    rng = random.Random(seed)
    lines, points = scene(rng)
    o = some_point(rng)
    d = some_direction(rng)
    hit = there(RayCaster(lines, points).cast(o, d))
    if hit.target < len(lines):
        assert 0.0 <= hit.position_m <= lines[hit.target].length_m + 1e-9
        expected = lines[hit.target].point_at(hit.position_m)
    else:
        assert hit.position_m == 0.0
        expected = points[hit.target - len(lines)]
    reach = vector.subtract(hit.point_m, o)

    assert math.dist(hit.point_m, expected) < 1e-9
    assert hit.range_m == pytest.approx(vector.norm(reach))
    assert hit.miss_rad == pytest.approx(vector.angle_between(d, reach), abs=1e-9)

    ahead = max(vector.dot(d, reach), 0.0)
    assert hit.miss_m == pytest.approx(math.dist(reach, vector.scale(d, ahead)), abs=1e-9)


def test_the_tolerance_decides_at_its_own_value() -> None:
    line = Polyline([(2.0, 1.0, 0.0), (2.0, 1.0, 5.0)])
    exact = math.atan2(1, 2)
    for lines in ([line], [line] * (FEW + 1)):  # in plain Python, and on arrays
        caster = RayCaster(lines)
        assert caster.cast((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), exact * 1.000001) is not None
        assert caster.cast((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), exact * 0.999999) is None


def test_grazing_along_a_long_strip() -> None:
    # eyes 2 cm above a strip of 10 m, pointing along it and ever so slightly down: it is met at 8 m
    strip = Polyline([(x / 100, 0.0, 0.0) for x in range(1001)])
    caster = RayCaster([strip])
    hit = there(caster.cast((0.0, 0.0, 0.02), vector.normalized((8.0, 0.0, -0.02)), 0.1))
    assert hit.position_m == pytest.approx(8.0, abs=1e-3)
    assert hit.miss_rad < 1e-7


def test_eyes_on_a_line_or_lamp_give_finite_hits() -> None:
    line = Polyline([(x / 10, 0.0, 0.0) for x in range(101)])
    lamps: list[Vec3] = [(5.0, 0.0, 0.0)]
    hit = there(RayCaster([line], lamps).cast((5.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    assert all(math.isfinite(x) for x in (*hit.point_m, hit.miss_m, hit.miss_rad, hit.range_m))


def test_a_direction_of_nearly_norm_one_is_taken_as_one() -> None:
    caster = RayCaster([Polyline([(2.0, -1.0, 0.0), (2.0, 1.0, 0.0)])])
    hit = there(caster.cast((0.0, 0.0, 0.0), (1.0009, 0.0, 0.0), 0.1))
    assert (hit.miss_rad, hit.miss_m, hit.range_m) == (0.0, 0.0, 2.0)


# what is further along the ray


@given(seeds, st.floats(-1.0, 6.0))
def test_ray_cast_cuts_off_points_beyond_the_reach(seed: int, reach_m: float) -> None:
    rng = random.Random(seed)
    lines, points = scene(rng)
    o = some_point(rng)
    d = some_direction(rng)
    for some, alone in ((lines, points), (lines[:1], points[:2])):  # on arrays, and in plain Python
        pieces: list[tuple[Vec3, Vec3]] = [(p, p) for p in alone]
        for line in some:
            places = [line.point_at(line.length_m * i / 300) for i in range(301)]
            pieces += [(p, p) for p in places]
        near = [p for p, _ in pieces if vector.dot(d, vector.subtract(p, o)) <= reach_m]
        hit = RayCaster(some, alone).cast(o, d, math.inf, reach_m)
        assert hit is not None or not near
        if hit is None:
            continue
        assert vector.dot(d, vector.subtract(hit.point_m, o)) <= reach_m + 1e-9
        best = min((make_hit(0, 0.0, p, o, d).miss_rad for p in near), default=math.inf)
        assert hit.miss_rad <= best + 3e-7
        if hit.target < len(some):
            assert math.dist(some[hit.target].point_at(hit.position_m), hit.point_m) < 1e-9


coordinates = st.floats(-5, 5)
points = st.tuples(coordinates, coordinates, coordinates)
azimuths = st.floats(-math.pi, math.pi)
elevations = st.floats(-math.pi / 2, math.pi / 2)
directions = st.builds(vector.direction, azimuths, elevations)
AHEAD: Vec3 = (1.0, 0.0, 0.0)


def least_angle(a: Vec3, u: Vec3, d: Vec3, count: int = 2001) -> float:
    """Return the least angle of many points of the segment."""
    t = np.linspace(0.0, 1.0, count)[:, None]
    q = np.array(a) + t * np.array(u)
    along = q @ np.array(d)
    across = np.linalg.norm(np.cross(np.array(d), q), axis=1)
    return float(np.arctan2(across, along).min())


def along(a: Vec3, u: Vec3, t: float) -> Vec3:
    return vector.add(a, vector.scale(u, t))


@example((2.0, -1.0, 0.0), (0.5, 3.0, 0.0), AHEAD)  # the ray meets the segment a third along it
@given(points, points, directions)
def test_no_point_is_at_a_smaller_angle(a: Vec3, u: Vec3, d: Vec3) -> None:
    # from 0 the angle jumps; that case is tested by hand
    assume(min(vector.norm(along(a, u, i / 200)) for i in range(201)) > 0.1)
    t, _ = nearest_in_angle(a, u, d)
    assert 0.0 <= t <= 1.0
    assert vector.angle_between(d, along(a, u, t)) <= least_angle(a, u, d) + 5e-8


def test_a_ray_along_the_segment() -> None:
    a = (2.0, 0.0, 0.0)
    u = (3.0, 0.0, 0.0)
    assert nearest_in_angle(a, u, AHEAD)[1] == pytest.approx(-1.0)
    backwards = (-1.0, 0.0, 0.0)
    assert nearest_in_angle(a, u, backwards)[1] == pytest.approx(1.0)


def test_a_segment_without_length_is_a_point() -> None:
    t, cost = nearest_in_angle((3.0, 4.0, 0.0), (0.0, 0.0, 0.0), AHEAD)
    assert 0.0 <= t <= 1.0
    assert cost == pytest.approx(-0.6)


def test_eyes_on_the_segment() -> None:
    a = (-1.0, -1.0, 0.0)
    u = (3.0, 3.0, 0.0)
    t, cost = nearest_in_angle(a, u, AHEAD)  # all points ahead are at 45 degrees, the eyes' own at none
    assert t == 1.0
    assert math.acos(-cost) == pytest.approx(math.radians(45))


def test_a_point_at_the_eyes_is_at_no_angle() -> None:
    assert nearest_in_angle((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), AHEAD) == (0.0, 1.0)
    hit = make_hit(0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), AHEAD)
    assert (hit.miss_m, hit.range_m) == (0.0, 0.0)
    assert math.isfinite(hit.miss_rad)


def test_miss_of_a_point_behind_is_its_distance_from_origin() -> None:
    hit = make_hit(0, 0.0, (-3.0, 4.0, 0.0), (0.0, 0.0, 0.0), AHEAD)
    assert hit.miss_m == pytest.approx(5.0)
    assert hit.miss_rad == pytest.approx(math.atan2(4.0, -3.0))
