"""Extent of a map from above, and the squares of its floor; without matplotlib, which pages do not need."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3
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
    # Points, and corners of squares around what is wide
    places: list[tuple[float, float]] = [] if person_m is None else [person_m]
    places += [lamp.position_m[:2] for lamp in room.lamps]
    for strip in room.strips:
        places += [vertex[:2] for vertex in strip.line_m]
    for belt in room.belts:
        for vertex in belt.line_m:
            places += _square_around(vertex, belt.width_m / 2)
    for box in (*room.boxes, *room.fixed_things):
        places += _square_around(box.center_m, math.hypot(*box.size_m[:2]) / 2)
    for plane in room.planes:
        half_m = math.hypot(*plane.size_m) / 2 if plane.size_m else 1.0
        places += _square_around(plane.center_m, half_m)
    for round_solid in (*room.cylinders, *room.spheres):
        places += _square_around(round_solid.center_m, round_solid.radius_m)
    for fence in room.fences:
        places += fence.outline_m
    for points in clouds.values():
        flat = points[:, :2]
        places += [tuple(flat.min(axis=0)), tuple(flat.max(axis=0))]

    # A map of tracked objects alone has no place
    array = np.array(places or [(0.0, 0.0)], dtype=np.float64)
    low = array.min(axis=0)
    high = array.max(axis=0)
    margin = max(MARGIN_M, MARGIN_SHARE * float((high - low).max()))
    low = low - margin
    high = high + margin
    width, height = high - low
    widening = max(0.0, MIN_ASPECT * height - width) / 2
    offset = np.array([widening, 0.0])
    return low - offset, high + offset


def _square_around(center_m: Vec3, half_m: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return two opposite corners of the square around a point, as seen from above."""
    x, y, _ = center_m
    return (x - half_m, y - half_m), (x + half_m, y + half_m)


def floor_edges(low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> tuple[list[float], list[float]]:
    """Return the x and the y (m) between which the squares of the floor lie, from `low_m` to `high_m`."""
    side_m = float((high_m - low_m).max()) / FLOOR_CELLS
    west_m, south_m = low_m.tolist()
    east_m, north_m = high_m.tolist()
    return _edges(west_m, east_m, side_m), _edges(south_m, north_m, side_m)


def _edges(low_m: float, high_m: float, step_m: float) -> list[float]:
    length_m = high_m - low_m
    count = max(1, round(length_m / step_m))
    return [low_m + length_m * number / count for number in range(count + 1)]
