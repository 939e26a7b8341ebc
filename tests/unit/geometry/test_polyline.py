"""Lines that are none, and what of a line is nearest; polygons: inside, distances and crossings."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import polyline
from pointit.geometry.floor_area import FloorArea, point_segment_m
from pointit.geometry.polyline import Polyline
from pointit.geometry.solids import Vec2

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
def test_what_is_past_an_end_is_beyond_it(first_m: float, second_m: float, past_m: float) -> None:
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
def test_a_segment_is_as_far_apart_as_the_nearest_of_its_points(
    shape: FloorArea, start: Vec2, end: Vec2
) -> None:
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
