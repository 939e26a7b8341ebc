"""The numbers that lights blink, in colours; `client/src/scan/code.ts` reads them, and says why so.

Step 0 is red, step 1 green. Every further step changes the colour of every light by one place in red, green,
blue for a bit 0 and by two for a 1: the bits of its index, the highest first, then two check bits.
"""

from collections.abc import Sequence

from pointit.schemas import LitPixels
from pointit.schemas.base import Rgb

COLORS: tuple[Rgb, ...] = ((255, 0, 0), (0, 255, 0), (0, 0, 255))
FIRST_BIT = 2
CHECK_BITS = 2
MARKS = 10
"""Marked pixels of a strip, its ends included. Three determine a line, the others find wrong numbers."""


def marked_pixels(count: int, marks: int = MARKS) -> tuple[int, ...]:
    """Return the numbers of marked pixels of a strip of `count` pixels, ends included, evenly spread."""
    marks = min(count, marks)
    return tuple(round(number * (count - 1) / max(1, marks - 1)) for number in range(marks))


def bits_of(lights: int) -> int:
    """Return the number of bits that tell `lights` lights apart."""
    return max(1, (lights - 1).bit_length())


def steps_of(lights: int) -> int:
    """Return the number of steps for `lights` lights."""
    return FIRST_BIT + bits_of(lights) + CHECK_BITS


def word_of(index: int, lights: int) -> list[int]:
    """Return the colour of light `index` of `lights` at each step, as index of `COLORS`."""
    count = bits_of(lights)
    bits = [index >> (count - 1 - k) & 1 for k in range(count)]
    check = sum((k + 1) * bit for k, bit in enumerate(bits)) % 4
    word = [0, 1]
    for bit in (*bits, check >> 1, check & 1):
        word.append((word[-1] + 1 + bit) % 3)
    return word


def picture(lights: Sequence[tuple[str, int]], step: int, brightness: float) -> tuple[LitPixels, ...]:
    """Return the lit pixels at `step`, or `()` before step 0.

    Args:
        lights: strip and pixel of each light.
        step: number of the step, from 0.
        brightness: 0 to 1.
    """
    lit: dict[tuple[str, int], list[int]] = {}
    if step >= 0:
        for index, (name, pixel) in enumerate(lights):
            lit.setdefault((name, word_of(index, len(lights))[step]), []).append(pixel)
    return tuple(
        LitPixels(id=name, pixels=tuple(pixels), color=_dimmed(COLORS[color], brightness))
        for (name, color), pixels in lit.items()
    )


def _dimmed(color: Rgb, brightness: float) -> Rgb:
    red, green, blue = (round(brightness * value) for value in color)
    return red, green, blue
