"""Positions that a body in metres with z up cannot have, and units and axes with which it could."""

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.rotation import Quaternion, rotate
from pointit.maps.units import LENGTHS_M, UP_AXES

MAX_DISTANCE_M = 100.0
"""Maximum distance from the origin."""
HEAD_RANGE_M = (0.5, 3.0)
"""Limits of the median height of a head over the floor."""
MAX_BELOW_FLOOR_M = 3.0
"""Maximum depth of a body below the floor, as of a file with another axis up."""
MAX_SPEED_MPS = 30.0
"""Maximum speed, which 90 % of the steps of a body keep to."""


def plausible_units(body: str, positions: Array, times_s: Array, size: float) -> dict[str, float]:
    """Return the units, instead of one of `size` m, with which positions are plausible.

    To each belongs the median distance in it, m.
    """
    distances_m: dict[str, float] = {}
    for unit, unit_m in LENGTHS_M.items():
        if find_implausible_positions(body, positions * (unit_m / size), times_s) is None:
            distance = float(np.nanmedian(np.linalg.norm(positions, axis=1)))
            distances_m[unit] = distance * unit_m / size
    return distances_m


def plausible_axes(body: str, in_file: Array, times_s: Array) -> list[str]:
    """Return the axes that may point up, for positions as they are `in_file`."""
    axes: list[str] = []
    for up, turn in UP_AXES.items():
        if find_implausible_positions(body, in_file @ rotation_matrix(turn), times_s) is None:
            axes.append(up)
    return axes


def plausible_units_and_axes(in_file: Array, times_s: Array, size: float, up: str) -> list[str]:
    """Return other units than `size` with other axes than `up` with which those of a head are plausible."""
    both: list[str] = []
    for unit, unit_m in LENGTHS_M.items():
        for axis, turn in UP_AXES.items():
            if unit_m == size or axis == up:
                continue
            positions = in_file @ rotation_matrix(turn) * (unit_m / size)
            if find_implausible_positions("head", positions, times_s) is None:
                both.append(f"{unit} with up {axis}")
    return both


def rotation_matrix(turn: Quaternion) -> Array:
    """Return the matrix by which rows of vectors are multiplied to be turned by `turn`."""
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return np.array([rotate(turn, axis) for axis in axes])


def find_implausible_positions(body: str, positions: Array, times_s: Array) -> tuple[int | None, str] | None:
    """Return the row and a clause about implausible `positions` of a body, n x k, m, z up.

    The row is None if the clause is about all, and the result None if they are plausible.
    """
    # Distance from the origin
    distances = np.linalg.norm(positions, axis=1)
    if body == "points":  # rays near the horizon meet the floor far away
        distances = np.where(np.isfinite(distances), np.nanmedian(distances), np.nan)
    far_rows = np.flatnonzero(distances > MAX_DISTANCE_M)
    for row in far_rows[:1].tolist():
        return row, f"is {distances[row]:.6g} m away, limit {MAX_DISTANCE_M:g} m"

    # Height, and then speed, of a body
    known = np.flatnonzero(np.isfinite(distances))
    if body == "points" or len(known) < 3:
        return None
    heights_m = positions[known, 2]
    height_m = float(np.median(heights_m))
    if body == "head" and not HEAD_RANGE_M[0] <= height_m <= HEAD_RANGE_M[1]:
        limits = f"{HEAD_RANGE_M[0]:g} to {HEAD_RANGE_M[1]:g} m"
        return None, f"is {height_m:.6g} m above the floor, plausible are {limits}"
    lowest_m = float(heights_m.min())
    if lowest_m < -MAX_BELOW_FLOOR_M:
        return None, f"is {-lowest_m:.6g} m below the floor, limit {MAX_BELOW_FLOOR_M:g} m"
    steps_m = np.linalg.norm(np.diff(positions[known], axis=0), axis=1)
    speeds_mps = steps_m / np.diff(times_s[known])
    speed_mps = float(np.percentile(speeds_mps, 90))
    if speed_mps > MAX_SPEED_MPS:
        return None, f"moves at {speed_mps:.6g} m/s, limit {MAX_SPEED_MPS:g} m/s"
    return None
