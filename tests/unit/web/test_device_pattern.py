"""The test pattern of a strip."""

from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.web.devices.devices import BLUE, GREEN, RED, pattern


@given(st.integers(1, 4096))
def test_pattern_lights_each_pixel_once_at_most_and_begins_green(pixels: int) -> None:
    lit = [(pixel, part.color) for part in pattern("a", pixels) for pixel in part.pixels]
    numbers = [pixel for pixel, _ in lit]
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == pixels - 1
    assert lit[0] == (0, GREEN)
    assert pixels == 1 or lit[-1][1] == RED


def test_colours_stand_in_their_order_between_the_ends() -> None:
    assert [part.color for part in pattern("a", 60)] == [GREEN, RED, GREEN, BLUE, RED]
    assert [len(part.pixels) for part in pattern("a", 60)] == [6, 14, 14, 14, 6]
