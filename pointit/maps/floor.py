"""Extent of a map from above, and the squares of its floor; without matplotlib, which pages do not need."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pointit.schemas import Environment

MARGIN_M = 0.6
MARGIN_SHARE = 0.06
"""Margin for text beside things, as a share of the longer side."""
MIN_ASPECT = 0.65
"""Minimum width by height, as a narrow map has space for text beside it."""
FLOOR_CELLS = 24
"""Number of squares along the longer side in which the floor is coloured."""


def extent(
    room: Environment, clouds: Mapping[str, NDArray[np.float64]], person_m: tuple[float, float] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the minimum and maximum x and y of the picture, with a margin."""
    places: list[tuple[float, float]] = [] if person_m is None else [person_m]
    places += [lamp.position_m[:2] for lamp in room.lamps]
    for strip in room.strips:
        places += [vertex[:2] for vertex in strip.line_m]
    for belt in room.belts:
        half = belt.width_m / 2
        for x, y, _ in belt.line_m:
            places += [(x - half, y - half), (x + half, y + half)]
    round_things = [
        *((box.center_m, math.hypot(*box.size_m[:2]) / 2) for box in (*room.boxes, *room.fixed_things)),
        *((each.center_m, math.hypot(*each.size_m) / 2 if each.size_m else 1.0) for each in room.planes),
        *((cylinder.center_m, cylinder.radius_m) for cylinder in room.cylinders),
        *((sphere.center_m, sphere.radius_m) for sphere in room.spheres),
    ]
    for (x, y, _), radius in round_things:
        places += [(x - radius, y - radius), (x + radius, y + radius)]
    for fence in room.fences:
        places += fence.outline_m
    for points in clouds.values():
        flat = points[:, :2]
        places += [tuple(flat.min(axis=0)), tuple(flat.max(axis=0))]
    array = np.array(places or [(0.0, 0.0)], dtype=np.float64)  # tracked objects have no place
    low = array.min(axis=0)
    high = array.max(axis=0)
    margin = max(MARGIN_M, MARGIN_SHARE * float((high - low).max()))
    low = low - margin
    high = high + margin
    more = np.array([max(0.0, MIN_ASPECT * (high - low)[1] - (high - low)[0]) / 2, 0.0])
    return low - more, high + more


def floor_edges(low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> tuple[list[float], list[float]]:
    """Return the x and the y (m) between which the squares of the floor lie, from `low_m` to `high_m`."""
    side_m = float((high_m - low_m).max()) / FLOOR_CELLS
    x_m, y_m = (_edges(*ends, side_m) for ends in zip(low_m.tolist(), high_m.tolist(), strict=True))
    return x_m, y_m


def _edges(low_m: float, high_m: float, step_m: float) -> list[float]:
    count = max(1, round((high_m - low_m) / step_m))
    return [low_m + (high_m - low_m) * number / count for number in range(count + 1)]
