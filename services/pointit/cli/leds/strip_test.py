"""Test pictures of one strip: its ends, its direction, its order of colours. Pure."""

from dataclasses import dataclass

from pointit.schemas import Strip
from pointit.schemas.base import Rgb, Vec3

DARK: Rgb = (0, 0, 0)
ENDS_S = 3.0
RUN_S = 4.0
"""Time in which a pixel runs along the strip, s."""
COLOR_S = 1.5
RUN_PICTURES = 120
"""Maximum number of pictures of the running pixel."""
COLORED_PIXELS = 10
COLORS: dict[str, Rgb] = {"red": (255, 0, 0), "green": (0, 255, 0), "blue": (0, 0, 255)}


@dataclass(frozen=True)
class Step:
    """Pictures that show one property of a strip."""

    text: str
    """Description of what is lit, for the person who looks."""
    pictures: tuple[bytes, ...]
    """Pixels of the strip, 3 bytes each."""
    period_s: float
    """Time for which each picture is shown, s."""


def steps_of(strip: Strip) -> list[Step]:
    """Return the steps that test `strip`."""
    first_m, last_m = strip.line_m[:: len(strip.line_m) - 1][:: strip.direction]
    ends = {0: COLORS["green"], strip.pixels - 1: COLORS["red"]}
    count = min(strip.pixels, RUN_PICTURES)
    run = [number * (strip.pixels - 1) // max(1, count - 1) for number in range(count)]
    begin = range(min(COLORED_PIXELS, strip.pixels))
    return [
        Step(
            f"first of {strip.pixels} pixels green, at {_place(first_m)} in the map; last red, at "
            f"{_place(last_m)}",
            (_picture(strip, ends),),
            ENDS_S,
        ),
        Step(
            "a white pixel runs from the green to the red end",
            tuple(_picture(strip, {pixel: (255, 255, 255)}) for pixel in run),
            RUN_S / count,
        ),
        *(
            Step(f"the first pixels are {name}", (_picture(strip, dict.fromkeys(begin, color)),), COLOR_S)
            for name, color in COLORS.items()
        ),
    ]


def _picture(strip: Strip, lit: dict[int, Rgb]) -> bytes:
    return b"".join(bytes(lit.get(pixel, DARK)) for pixel in range(strip.pixels))


def _place(position_m: Vec3) -> str:
    return "(" + ", ".join(f"{value:g}" for value in position_m) + ") m"
