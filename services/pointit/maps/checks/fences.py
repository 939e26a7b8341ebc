"""Checks of fences: robots must have somewhere to be."""

from collections.abc import Iterator, Mapping

import numpy as np

from pointit.geometry.polygon import Polygon
from pointit.maps.checks.finding import Finding, error, warning
from pointit.maps.model import FenceEntry

ROBOT_M = 0.5
"""Width below which a volume to stay in has hardly room for a robot."""
GRID = 48
"""Places along x and y at which a common area is looked for."""


def check_fences(fences: Mapping[str, FenceEntry]) -> Iterator[Finding]:
    """Yield volumes that hold no robot, alone or together."""
    inside = {name: each for name, each in fences.items() if each.kind == "keep_in"}
    for name, each in inside.items():
        xs, ys = zip(*each.outline, strict=True)
        least = min(max(xs) - min(xs), max(ys) - min(ys))
        if least < ROBOT_M:
            yield warning(
                f"fences.{name}", f"is {least:g} m wide, and robots stay inside; give its corners in metres"
            )
        if each.high is not None and each.high <= 0.0:
            yield error(f"fences.{name}", f"ends at {each.high:g} m, not above the floor; raise high")
    if inside and len(fences) > 1 and not _have_room(fences):
        yield error(
            "fences." + ", ".join(inside),
            "leave no place for a robot: it stays inside every keep_in and outside every keep_out; "
            "correct one",
        )


def _have_room(fences: Mapping[str, FenceEntry]) -> bool:
    """Return True if a point is found inside every `keep_in` and outside every `keep_out`."""
    inside = [each for each in fences.values() if each.kind == "keep_in"]
    low_z = max(_or(each.low, -np.inf) for each in inside)
    high_z = min(_or(each.high, np.inf) for each in inside)
    low = np.max([np.min(each.outline, axis=0) for each in inside], axis=0)
    high = np.min([np.max(each.outline, axis=0) for each in inside], axis=0)
    if low_z >= high_z or np.any(low >= high):
        return False
    outlines = {name: Polygon(each.outline) for name, each in fences.items()}
    steps = (np.arange(GRID) + 0.5) / GRID
    for x in low[0] + steps * (high[0] - low[0]):
        for y in low[1] + steps * (high[1] - low[1]):
            place = (float(x), float(y))
            closed: list[tuple[float, float]] = []
            for name, each in fences.items():
                if outlines[name].contains(place) == (each.kind == "keep_out"):
                    if each.kind == "keep_in":
                        break
                    closed.append((_or(each.low, -np.inf), _or(each.high, np.inf)))
            else:
                if _has_gap(low_z, high_z, closed):
                    return True
    return False


def _or(height: float | None, otherwise: float) -> float:
    return otherwise if height is None else height


def _has_gap(low: float, high: float, closed: list[tuple[float, float]]) -> bool:
    """Return True if the intervals of heights `closed` leave some of that from `low` to `high`."""
    for start, end in sorted(closed):
        if start > low:
            return True
        low = max(low, end)
    return low < high
