"""Marked pixels of strips, and what they show. The numbers that they blink: `scan.test.ts`."""

import itertools

import pytest

from pointit.bridges.web.scan.session import marked_pixels, picture


@pytest.mark.parametrize(("count", "marked"), [(1, (0,)), (2, (0, 1)), (5, (0, 1, 2, 3, 4))])
def test_short_strips_are_marked_whole(count: int, marked: tuple[int, ...]) -> None:
    assert marked_pixels(count) == marked


def test_long_strips_are_marked_from_end_to_end() -> None:
    marked = marked_pixels(144)
    assert (marked[0], marked[-1], len(marked)) == (0, 143, 10)
    assert {b - a for a, b in itertools.pairwise(marked)} <= {15, 16}


def test_every_light_shows_its_colour_and_nothing_else_shines() -> None:
    lit = picture([("a", 0), ("a", 3), ("b", 1), ("a", 5)], [0, 1, 2, 0], 0.5)
    assert {(each.id, each.pixels): each.color for each in lit} == {
        ("a", (0, 5)): (128, 0, 0),
        ("a", (3,)): (0, 128, 0),
        ("b", (1,)): (0, 0, 128),
    }
