"""Polygons: inside, distances and crossings, against a sampled reference."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry.polygon import Polygon, Vec2, point_segment_m

coordinate = st.floats(-4.0, 4.0).map(lambda value: round(value, 3))
point = st.tuples(coordinate, coordinate)

L_SHAPE = Polygon([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)])


@st.composite
def stars(draw: st.DrawFn) -> Polygon:
    """Polygons around the origin whose corners have rising azimuths, which never cross themselves."""
    count = draw(st.integers(3, 8))
    radii = draw(st.lists(st.floats(0.5, 3.0), min_size=count, max_size=count))
    return Polygon(
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
def test_the_distance_of_a_segment_is_the_least_of_its_points(shape: Polygon, start: Vec2, end: Vec2) -> None:
    least = min(min(point_segment_m(each, a, b) for a, b in shape.edges_m) for each in sampled(start, end))
    exact = shape.outline_distance_m(start, end)
    assert exact <= least + 1e-9
    assert least <= exact + math.dist(start, end) / 200


@given(stars(), point, point)
def test_a_segment_that_changes_sides_meets_the_outline(shape: Polygon, start: Vec2, end: Vec2) -> None:
    if shape.contains(start) != shape.contains(end):
        assert shape.outline_distance_m(start, end) < 1e-9


@given(stars(), point)
def test_the_nearest_point_is_on_the_outline_at_the_distance(shape: Polygon, place: Vec2) -> None:
    nearest = shape.nearest(place)
    assert abs(shape.signed_distance_m(nearest)) < 1e-9
    assert abs(shape.signed_distance_m(place)) == pytest.approx(math.dist(nearest, place))


@given(stars())
def test_a_star_does_not_cross_itself(shape: Polygon) -> None:
    assert shape.crossing() is None


@pytest.mark.parametrize(
    ("outline", "edges"),
    [([(0, 0), (2, 2), (2, 0), (0, 2)], (0, 2)), ([(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)], (0, 2))],
)
def test_an_outline_that_crosses_or_touches_itself_is_found(
    outline: list[Vec2], edges: tuple[int, int]
) -> None:
    assert Polygon(outline).crossing() == edges
