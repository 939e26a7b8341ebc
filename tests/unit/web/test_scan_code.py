"""The numbers that lights blink; `scan.test.ts` has the same word."""

import itertools

import pytest

from pointit.bridges.web.scan.code import COLORS, marked_pixels, picture, steps_of, word_of


@pytest.mark.parametrize("lights", [1, 2, 24, 220])
def test_every_light_has_a_word_of_its_own_and_changes_at_every_step(lights: int) -> None:
    words = [tuple(word_of(index, lights)) for index in range(lights)]
    assert len(set(words)) == lights
    for word in words:
        assert len(word) == steps_of(lights)
        assert all(before != now for before, now in itertools.pairwise(word))


def test_the_word_is_that_which_the_page_reads() -> None:
    assert word_of(5, 24) == [0, 1, 2, 0, 2, 0, 2, 0, 1]


@pytest.mark.parametrize(("count", "marked"), [(1, (0,)), (2, (0, 1)), (5, (0, 1, 2, 3, 4))])
def test_short_strips_are_marked_whole(count: int, marked: tuple[int, ...]) -> None:
    assert marked_pixels(count) == marked


def test_long_strips_are_marked_from_end_to_end() -> None:
    marked = marked_pixels(144)
    assert (marked[0], marked[-1], len(marked)) == (0, 143, 10)
    assert {b - a for a, b in itertools.pairwise(marked)} <= {15, 16}


def test_a_step_shows_every_light_in_its_colour_and_nothing_else() -> None:
    lights = [("a", 0), ("a", 3), ("b", 1)]
    for step in range(steps_of(3)):
        shown = {(each.id, pixel): each.color for each in picture(lights, step, 0.5) for pixel in each.pixels}
        for index, light in enumerate(lights):
            assert shown[light] == tuple(value * 128 // 255 for value in COLORS[word_of(index, 3)[step]])
        assert len(shown) == 3
    assert picture(lights, -1, 1.0) == ()
