"""Lights that are told apart by the colours that they blink: marked pixels of strips, and lamps."""

from collections.abc import Sequence

from pointit.schemas import LitPixels
from pointit.schemas.base import Rgb

COLORS: tuple[Rgb, ...] = ((255, 0, 0), (0, 255, 0), (0, 0, 255))
MARKS = 10
"""Marked pixels of a strip, its ends included. Three determine a line, the others find wrong numbers."""


def marked_pixels(count: int, marks: int = MARKS) -> tuple[int, ...]:
    """Return the numbers of marked pixels of a strip of `count` pixels, ends included, evenly spread."""
    marks = min(count, marks)
    return tuple(round(number * (count - 1) / max(1, marks - 1)) for number in range(marks))


def picture(
    lights: Sequence[tuple[str, int]], colors: Sequence[int], brightness: float
) -> tuple[LitPixels, ...]:
    """Return the lit pixels of `lights` (strip and pixel), of which each has one of `COLORS`, dimmed."""
    lit: dict[tuple[str, int], list[int]] = {}
    for (name, pixel), color in zip(lights, colors, strict=True):
        lit.setdefault((name, color), []).append(pixel)
    return tuple(
        LitPixels(id=name, pixels=tuple(pixels), color=_dimmed(COLORS[color], brightness))
        for (name, color), pixels in lit.items()
    )


def _dimmed(color: Rgb, brightness: float) -> Rgb:
    red, green, blue = (round(brightness * value) for value in color)
    return red, green, blue
