"""The test pattern of a strip: where it begins and ends, and in which order its colours are. Pure."""

from pointit.schemas import LitPixels
from pointit.schemas.base import Rgb

PATTERN_S = 6.0
"""Time for which the pattern is shown, s."""
ENDS = 0.1
"""Share of the pixels of each end."""
RED: Rgb = (255, 0, 0)
GREEN: Rgb = (0, 255, 0)
BLUE: Rgb = (0, 0, 255)


def pattern(strip: str, pixels: int) -> tuple[LitPixels, ...]:
    """Return the first tenth green, the last tenth red, and between them red, green and blue thirds.

    A dark pixel is between neighbours, where there is room.
    """
    end = max(1, round(ENDS * pixels))
    inner = range(end + 1, pixels - end - 1)
    third = len(inner) // 3
    parts: list[tuple[range, Rgb]] = [(range(end), GREEN)]
    for number, color in enumerate((RED, GREEN, BLUE)):
        parts.append((inner[number * third : (number + 1) * third - 1], color))
    if pixels > end:
        parts.append((range(pixels - end, pixels), RED))
    return tuple(LitPixels(id=strip, pixels=tuple(lit), color=color) for lit, color in parts if len(lit))
