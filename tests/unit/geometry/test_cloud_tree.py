"""Clouds: the tree against looking at every point, and against the paper's nearest neighbours."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.cloud_tree import LEAF_POINTS, CloudMeasure, CloudTree, PointTree
from pointit.geometry.vector import Vec3
from tests.support import there

Array = NDArray[np.float64]
MEASURES: list[CloudMeasure] = ["angle", "metres", "samples"]
seeds = st.integers(0, 2**32 - 1)


def some_cloud(rng: np.random.Generator) -> Array:
    """Return walls, a ball of points and lone points, from one to some thousands."""
    count = int(rng.choice([1, 5, LEAF_POINTS, LEAF_POINTS + 1, 1000, 5000]))
    walls = rng.uniform(-5, 5, (count, 3))
    walls[: count // 2, int(rng.integers(3))] = rng.uniform(-5, 5)
    walls[count // 2 : count // 2 + count // 4] = rng.normal(0, 0.05, (count // 4, 3)) + rng.uniform(-5, 5, 3)
    return walls


def some_ray(rng: np.random.Generator) -> tuple[Vec3, Vec3]:
    x, y, z = rng.uniform(-5, 5, 3).tolist()
    return (x, y, z), vector.direction(float(rng.uniform(-3.1, 3.1)), float(rng.uniform(-1.5, 1.5)))


@given(seeds, st.sampled_from(MEASURES))
def test_no_point_is_overlooked(seed: int, measure: CloudMeasure) -> None:
    rng = np.random.default_rng(seed)
    points = some_cloud(rng)
    tree = CloudTree(points, measure=measure, step_m=STEP_M, length_m=LENGTH_M)
    for _ in range(5):
        origin, direction = some_ray(rng)
        expected = misses(points, origin, direction, measure)
        hit = there(tree.cast(origin, direction))
        assert expected[hit.target] == pytest.approx(expected.min(), abs=2e-7)
        assert math.dist(hit.point_m, points[hit.target].tolist()) == 0.0


@given(seeds, st.sampled_from(MEASURES), st.floats(0.01, 1.0))
def test_nothing_beyond_tolerance_and_all_within(seed: int, measure: CloudMeasure, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    points = some_cloud(rng)
    origin, direction = some_ray(rng)
    expected = misses(points, origin, direction, measure)
    assume(abs(expected.min() - tolerance) > 1e-6)
    tree = CloudTree(points, measure=measure, step_m=STEP_M, length_m=LENGTH_M)
    hit = tree.cast(origin, direction, tolerance)
    assert (hit is not None) == (expected.min() <= tolerance)
    if hit is not None:
        assert expected[hit.target] == pytest.approx(expected.min(), abs=2e-7)


@given(seeds, st.sampled_from(MEASURES), st.floats(-2.0, 6.0))
def test_points_beyond_the_reach_are_left_out(seed: int, measure: CloudMeasure, reach_m: float) -> None:
    rng = np.random.default_rng(seed)
    points = some_cloud(rng)
    origin, direction = some_ray(rng)
    expected = misses(points, origin, direction, measure)
    near = (points - np.array(origin)) @ np.array(direction) <= reach_m
    hit = CloudTree(points, measure=measure, step_m=STEP_M, length_m=LENGTH_M).cast(
        origin, direction, math.inf, reach_m
    )
    assert (hit is not None) == bool(near.any())
    if hit is not None:
        assert near[hit.target]
        assert expected[hit.target] == pytest.approx(expected[near].min(), abs=2e-7)


def test_a_hundred_thousand_points_take_more_than_one_level() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-5, 5, (100_000, 3))
    tree = CloudTree(points)
    for _ in range(10):
        origin, direction = some_ray(rng)
        hit = there(tree.cast(origin, direction))
        assert hit.miss_rad == pytest.approx(misses(points, origin, direction, "angle").min(), abs=2e-7)


@pytest.mark.parametrize("measure", MEASURES)
def test_one_place_many_times_and_eyes_in_it(measure: CloudMeasure) -> None:
    tree = CloudTree([(1.0, 2.0, 3.0)] * 200, measure=measure)
    hit = there(tree.cast((1.0, 2.0, 3.0), (1.0, 0.0, 0.0)))
    assert all(math.isfinite(x) for x in (*hit.point_m, hit.miss_m, hit.miss_rad, hit.range_m))


def test_lines_points_and_clouds_of_a_point_tree_are_numbered_in_turn() -> None:
    cloud = np.array([[5.0, 0.0, 0.0], [0.0, 5.0, 0.0]])
    tree = PointTree([], [(0.0, 0.0, 5.0)], [cloud[:1], cloud[1:]])
    for direction, target in (((0.0, 0.0, 1.0), 0), ((1.0, 0.0, 0.0), 1), ((0.0, 1.0, 0.0), 2)):
        hit = there(tree.cast((0.0, 0.0, 0.0), direction, 0.1))
        assert hit.target == target


@pytest.mark.parametrize("points", [[], [(0.0, math.nan, 0.0)], [(math.inf, 0.0, 0.0)]])
def test_no_points_or_no_numbers(points: list[Vec3]) -> None:
    with pytest.raises(ValueError, match="cloud"):
        CloudTree(points)


STEP_M, LENGTH_M = 0.05, 8.0
"""Spacing of `samples`."""


def misses(points: Array, origin: Vec3, direction: Vec3, measure: CloudMeasure) -> Array:
    """Return the miss of every point; `samples` by distances to all points of the ray."""
    reach = points - np.array(origin)
    d = np.array(direction)
    along: Array = reach @ d
    (x, y, z), (a, b, c) = reach.T, direction
    across: Array = np.sqrt((b * z - c * y) ** 2 + (c * x - a * z) ** 2 + (a * y - b * x) ** 2)  # |d x reach|
    if measure == "angle":
        angles: Array = np.arctan2(across, along)
        return angles
    if measure == "metres":
        distances: Array = np.hypot(across, np.minimum(along, 0.0))
        return distances
    count = math.ceil(LENGTH_M / STEP_M)
    on_ray = np.linspace(0.0, LENGTH_M, count + 1)[:, None] * d
    return np.asarray(np.min([np.linalg.norm(reach - place, axis=1) for place in on_ray], axis=0))
