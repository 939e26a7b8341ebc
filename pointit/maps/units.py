"""Units and vertical axes that the user declares for files of other programs."""

from pointit.geometry.rotation import IDENTITY, Quaternion, from_axis_angle
from pointit.geometry.vector import Vec3

LENGTHS_M = {
    "m": 1.0,
    "dm": 0.1,
    "cm": 0.01,
    "mm": 0.001,
    "um": 1e-6,
    "km": 1000.0,
    "in": 0.0254,
    "ft": 0.3048,
    "usft": 1200 / 3937,
}
"""Lengths of the units of length, m."""
TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
"""Durations of the units of time, s."""

_QUARTER_RAD = 1.5707963267948966
_X: Vec3 = (1.0, 0.0, 0.0)
_Y: Vec3 = (0.0, 1.0, 0.0)
UP_AXES: dict[str, Quaternion] = {
    "z": IDENTITY,
    "y": from_axis_angle(_X, _QUARTER_RAD),
    "-y": from_axis_angle(_X, -_QUARTER_RAD),
    "x": from_axis_angle(_Y, -_QUARTER_RAD),
    "-x": from_axis_angle(_Y, _QUARTER_RAD),
    "-z": from_axis_angle(_X, 2 * _QUARTER_RAD),
}
"""Rotations of vectors of a file into a frame with z up, by the axis of the file that points up."""


def size_of_unit(text: str, units: dict[str, float]) -> float:
    """Return the size of a unit: a name in `units`, or a number of SI units above 0.

    Raises:
        ValueError: If it is neither.
    """
    size = units[text] if text in units else float(text)
    if not 0.0 < size < 1e6:
        raise ValueError
    return size
