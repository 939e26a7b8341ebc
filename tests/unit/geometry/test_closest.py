"""One segment and one ray: the closed forms against brute force, and what is awkward about them."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.closest import make_hit, nearest_in_angle, nearest_in_metres
from pointit.geometry.vector import Vec3

coordinates = st.floats(-5, 5)
points = st.tuples(coordinates, coordinates, coordinates)
azimuths = st.floats(-math.pi, math.pi)
elevations = st.floats(-math.pi / 2, math.pi / 2)
directions = st.builds(vector.direction, azimuths, elevations)

AHEAD: Vec3 = (1.0, 0.0, 0.0)


def misses(a: Vec3, u: Vec3, d: Vec3, count: int = 2001) -> tuple[float, float]:
    """Return the least angle and the least distance of many points of the segment."""
    t = np.linspace(0.0, 1.0, count)[:, None]
    q = np.array(a) + t * np.array(u)
    along = q @ np.array(d)
    across = np.linalg.norm(np.cross(np.array(d), q), axis=1)
    distance = np.sqrt(across**2 + np.minimum(along, 0.0) ** 2)
    return float(np.arctan2(across, along).min()), float(distance.min())


def at(a: Vec3, u: Vec3, t: float) -> Vec3:
    return vector.add(a, vector.scale(u, t))


@given(points, points, directions)
def test_no_point_is_at_a_smaller_angle(a: Vec3, u: Vec3, d: Vec3) -> None:
    # from 0 the angle jumps; that case is tested by hand
    assume(min(vector.norm(at(a, u, i / 200)) for i in range(201)) > 0.1)
    t, _ = nearest_in_angle(a, u, d)
    assert 0.0 <= t <= 1.0
    assert vector.angle_between(d, at(a, u, t)) <= misses(a, u, d)[0] + 5e-8


@given(points, points, directions)
def test_no_point_is_nearer_in_metres(a: Vec3, u: Vec3, d: Vec3) -> None:
    t, _ = nearest_in_metres(a, u, d)
    assert 0.0 <= t <= 1.0
    assert make_hit(0, 0.0, at(a, u, t), (0.0, 0.0, 0.0), d).miss_m <= misses(a, u, d)[1] + 5e-7


def test_nearest_in_metres_is_not_nearest_in_angle() -> None:
    # a strip that runs away from the ray: near the eyes it is close in metres, far out in angle
    a, u = (1.0, 0.5, 0.0), (9.0, 0.5, 0.0)
    assert nearest_in_metres(a, u, AHEAD)[0] == 0.0
    assert nearest_in_angle(a, u, AHEAD)[0] == 1.0


def test_a_segment_across_the_ray_is_hit_where_it_crosses() -> None:
    for nearest in (nearest_in_angle, nearest_in_metres):
        assert nearest((2.0, -1.0, 0.0), (0.0, 4.0, 0.0), AHEAD)[0] == pytest.approx(0.25)


def test_a_segment_behind_is_missed_by_its_best_end() -> None:
    a, u = (-1.0, 1.0, 0.0), (-4.0, 0.0, 0.0)
    t, cost = nearest_in_angle(a, u, AHEAD)
    assert t == 0.0
    assert math.acos(-cost) == pytest.approx(math.radians(135))
    t, cost = nearest_in_metres(a, u, AHEAD)
    assert t == 0.0
    assert math.sqrt(cost) == pytest.approx(math.sqrt(2))


def test_a_segment_that_passes_the_person_is_met_at_the_eyes_in_metres_and_ahead_in_angle() -> None:
    a, u = (-2.0, 1.0, 0.0), (6.0, 0.0, 0.0)  # beside the person, parallel to the ray, half behind
    assert nearest_in_metres(a, u, AHEAD)[1] == pytest.approx(1.0)
    assert nearest_in_angle(a, u, AHEAD)[0] == 1.0
    away = vector.normalized((-1.0, -0.2, 0.0))
    assert nearest_in_metres(a, u, away)[0] == pytest.approx(1 / 3)


def test_a_ray_along_the_segment() -> None:
    a, u = (2.0, 0.0, 0.0), (3.0, 0.0, 0.0)
    assert nearest_in_metres(a, u, AHEAD)[1] == pytest.approx(0.0, abs=1e-12)
    assert nearest_in_angle(a, u, AHEAD)[1] == pytest.approx(-1.0)
    backwards = (-1.0, 0.0, 0.0)
    assert nearest_in_metres(a, u, backwards) == (0.0, 4.0)
    assert nearest_in_angle(a, u, backwards)[1] == pytest.approx(1.0)


def test_a_segment_without_length_is_a_point() -> None:
    for nearest, expected in ((nearest_in_angle, -0.6), (nearest_in_metres, 16.0)):
        t, cost = nearest((3.0, 4.0, 0.0), (0.0, 0.0, 0.0), AHEAD)
        assert 0.0 <= t <= 1.0
        assert cost == pytest.approx(expected)


def test_eyes_on_the_segment() -> None:
    a, u = (-1.0, -1.0, 0.0), (3.0, 3.0, 0.0)
    t, cost = nearest_in_metres(a, u, AHEAD)
    assert cost == pytest.approx(0.0, abs=1e-12)
    assert t == pytest.approx(1 / 3)
    t, cost = nearest_in_angle(a, u, AHEAD)  # all points ahead are at 45 degrees, the eyes' own at none
    assert t == 1.0
    assert math.acos(-cost) == pytest.approx(math.radians(45))


def test_a_point_at_the_eyes_is_at_no_angle() -> None:
    assert nearest_in_angle((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), AHEAD) == (0.0, 1.0)
    hit = make_hit(0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), AHEAD)
    assert (hit.miss_m, hit.range_m) == (0.0, 0.0)
    assert math.isfinite(hit.miss_rad)


def test_miss_of_a_point_behind_the_ray_is_its_distance_to_the_origin() -> None:
    hit = make_hit(0, 0.0, (-3.0, 4.0, 0.0), (0.0, 0.0, 0.0), AHEAD)
    assert hit.miss_m == pytest.approx(5.0)
    assert hit.miss_rad == pytest.approx(math.atan2(4.0, -3.0))
