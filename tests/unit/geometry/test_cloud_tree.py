"""Clouds: the tree against looking at every point."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.cloud_tree import LEAF_POINTS, CloudTree
from pointit.geometry.vector import Vec3
from tests.support import there

Array = NDArray[np.float64]
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


@given(seeds, st.floats(0.01, 1.0))
def test_nothing_beyond_tolerance_and_all_within(seed: int, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    points = some_cloud(rng)
    origin, direction = some_ray(rng)
    expected = misses(points, origin, direction)
    assume(abs(expected.min() - tolerance) > 1e-6)
    tree = CloudTree(points)
    hit = tree.cast(origin, direction, tolerance)
    assert (hit is not None) == (expected.min() <= tolerance)
    if hit is not None:
        assert expected[hit.target] == pytest.approx(expected.min(), abs=2e-7)


@given(seeds, st.floats(-2.0, 6.0))
def test_points_beyond_the_reach_are_left_out(seed: int, reach_m: float) -> None:
    rng = np.random.default_rng(seed)
    points = some_cloud(rng)
    origin, direction = some_ray(rng)
    expected = misses(points, origin, direction)
    near = (points - np.array(origin)) @ np.array(direction) <= reach_m
    hit = CloudTree(points).cast(origin, direction, math.inf, reach_m)
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
        assert hit.miss_rad == pytest.approx(misses(points, origin, direction).min(), abs=2e-7)


def test_one_place_many_times_and_eyes_in_it() -> None:
    tree = CloudTree([(1.0, 2.0, 3.0)] * 200)
    hit = there(tree.cast((1.0, 2.0, 3.0), (1.0, 0.0, 0.0)))
    assert all(math.isfinite(x) for x in (*hit.point_m, hit.miss_m, hit.miss_rad, hit.range_m))


@pytest.mark.parametrize("points", [[], [(0.0, math.nan, 0.0)], [(math.inf, 0.0, 0.0)]])
def test_no_points_or_no_numbers(points: list[Vec3]) -> None:
    with pytest.raises(ValueError, match="cloud"):
        CloudTree(points)


def misses(points: Array, origin: Vec3, direction: Vec3) -> Array:
    """Return the angle of every point, rad."""
    reach = points - np.array(origin)
    d = np.array(direction)
    along: Array = reach @ d
    (x, y, z), (a, b, c) = reach.T, direction
    across: Array = np.sqrt((b * z - c * y) ** 2 + (c * x - a * z) ** 2 + (a * y - b * x) ** 2)  # |d x reach|
    return np.asarray(np.arctan2(across, along))
