"""Correction of a person's systematic error in the raw ray (pointing.md §3)."""

import math

from pointit.geometry import vector
from pointit.schemas import PointingOffset

MAX_CORRECTION_RAD = math.radians(30.0)
"""Largest correction."""
FADE_RAD = math.radians(10.0)
"""Distance from straight up or down within which a correction fades, since azimuths are undefined there."""

_LEVEL_AT_FADE = math.sin(FADE_RAD)


def apply(
    offset: PointingOffset, azimuth_world_rad: float | None, elevation_rad: float
) -> tuple[float, float]:
    """Return the corrections of the ray's azimuth and elevation, rad.

    Args:
        offset: the person's.
        azimuth_world_rad: of the raw ray in {W}. None while the pose is unknown: then only the elevation is
            corrected, as at the middle azimuth of the anchors.
        elevation_rad: of the raw ray.
    """
    if offset.rung == "pitch":
        azimuth, elevation = 0.0, offset.elevation[0]
    else:
        a = 0.0 if azimuth_world_rad is None else vector.wrap(azimuth_world_rad - offset.reference_rad)
        a = _clamped(a, offset.azimuth_range_rad)
        e = _clamped(elevation_rad, offset.elevation_range_rad)
        elevation = _value(offset.elevation, a, e)
        azimuth = 0.0 if azimuth_world_rad is None else _value(offset.azimuth, a, e)
    fade = min(1.0, math.cos(elevation_rad) / _LEVEL_AT_FADE)
    azimuth = fade * min(max(azimuth, -MAX_CORRECTION_RAD), MAX_CORRECTION_RAD)
    elevation = fade * min(max(elevation, -MAX_CORRECTION_RAD), MAX_CORRECTION_RAD)
    lowest, highest = -math.pi / 2.0 - elevation_rad, math.pi / 2.0 - elevation_rad
    return azimuth, min(max(elevation, lowest), highest)


def _clamped(angle_rad: float, bounds: tuple[float, float]) -> float:
    """Return `angle_rad` clamped to the range of the anchors."""
    return min(max(angle_rad, bounds[0]), bounds[1])


def _value(terms: tuple[float, float, float, float, float, float], a: float, e: float) -> float:
    c, by_a, by_e, by_aa, by_ae, by_ee = terms
    return c + a * (by_a + a * by_aa + e * by_ae) + e * (by_e + e * by_ee)
