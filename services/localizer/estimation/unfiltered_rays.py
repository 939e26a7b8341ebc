"""Rays of a person without the pointer's filter: directions, origins and mean."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import FARTHEST, PointingRay
from pointit.services.localizer.estimation.solution import SolverSettings

MIN_BIAS_SIGMA_RAD = math.radians(1.0)
"""Lower bound of an elevation's standard deviation, whatever its calibration (pointing.md §3)."""


def unfiltered(ray: PointingRay) -> Vec3:
    """Return the direction of `ray` in {H}, corrected by the person's offset but not filtered."""
    raw = ray.raw_direction
    if raw is None:
        return ray.direction
    if ray.azimuth_correction_rad == 0.0 and ray.elevation_correction_rad == 0.0:
        return raw
    azimuth_rad = vector.azimuth(raw) + ray.azimuth_correction_rad
    elevation_rad = vector.elevation(raw) + ray.elevation_correction_rad
    return vector.direction(azimuth_rad, elevation_rad)


def directions(rays: Sequence[PointingRay]) -> Array:
    """Return the unfiltered directions of `rays` (n x 3)."""
    return np.array([unfiltered(ray) for ray in rays], dtype=np.float64).reshape(-1, 3)


def origins(rays: Sequence[PointingRay]) -> Array:
    """Return the origins of `rays` (n x 3, {H})."""
    return np.array([ray.origin_m for ray in rays], dtype=np.float64).reshape(-1, 3)


def believed(settings: SolverSettings, rays: Iterable[PointingRay]) -> SolverSettings:
    """Return `settings` with the elevation uncertainty of the person's calibration, which leaves no bias.

    Only if all rays are of a calibrated person; the largest sigma counts.
    """
    sigmas: list[float] = []
    for ray in rays:
        if ray.elevation_sigma_rad is None:
            return settings
        sigmas.append(ray.elevation_sigma_rad)
    if not sigmas:
        return settings
    sigma_rad = max(MIN_BIAS_SIGMA_RAD, min(max(sigmas), settings.bias_sigma_rad))
    return replace(settings, bias_rad=0.0, bias_sigma_rad=sigma_rad)


@dataclass(frozen=True, slots=True)
class Mean:
    """Mean of several rays."""

    origin_m: Vec3
    direction: Vec3
    """Unfiltered, unit, {H}."""
    raw_direction: Vec3
    """Neither filtered nor corrected."""
    spread_rad: float
    """Rms angle of the rays about their mean."""
    stamp_ns: int
    """Middle of their time."""
    samples: int
    sigma_rad: float | None = None
    """Standard deviation of the pointing sideways. None: that of pointing at a lamp."""


def mean(rays: Sequence[PointingRay]) -> Mean | None:
    """Return the mean of `rays`, in order of time, or None if there are none or they cancel each other."""
    if not rays:
        return None
    ray_directions = directions(rays)
    raw_directions = np.array([ray.raw_direction or ray.direction for ray in rays])
    mean_direction = _unit(ray_directions)
    mean_raw_direction = _unit(raw_directions)
    if mean_direction is None or mean_raw_direction is None:
        return None
    sines = np.linalg.norm(np.cross(ray_directions, mean_direction), axis=1)
    angles = np.arctan2(sines, ray_directions @ mean_direction)
    mean_origin = origins(rays).mean(axis=0)
    first_ns = rays[0].stamp_ns
    last_ns = rays[-1].stamp_ns
    return Mean(
        origin_m=_vec3(np.clip(mean_origin, -FARTHEST, FARTHEST)),
        direction=_vec3(mean_direction),
        raw_direction=_vec3(mean_raw_direction),
        spread_rad=float(np.sqrt(np.mean(angles**2))),
        stamp_ns=first_ns + (last_ns - first_ns) // 2,
        samples=len(rays),
    )


def _unit(vectors: Array) -> Array | None:
    vector_mean: Array = vectors.mean(axis=0)
    length = float(np.linalg.norm(vector_mean))
    return vector_mean / length if length > 1e-6 else None


def _vec3(values: Array) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
