"""Probability that a person who points selects the thing that they mean, by the covariance of their pose."""

import math
from collections.abc import Sequence

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import Array, Complex

DRAWS = np.random.default_rng(0).standard_normal((60, 3))
"""Standard normal errors of x, y and yaw, the same ones each time: equal rays give equal verdicts."""

DIRECTIONS: Complex = np.asarray(3.0 * np.exp(0.25j * math.pi * np.arange(8)), dtype=np.complex128)
"""Things of a map that has none, relative to the person, m: robots and belts are 2 to 4 m away."""

MAX_THINGS = 16
"""Number of things that are judged, the nearest ones."""

NEAREST_M = 0.95
"""Smallest distance of a thing by which a pose is judged: no pose is certain enough for nearer ones."""

MIN_ANGLE_RAD, MAX_ANGLE_RAD = math.radians(10.0), math.radians(30.0)
"""A ray this near to a thing selects it: light tells neighbours apart. One farther away selects nothing."""


def things_around(things_m: Sequence[Sequence[float]], place_m: complex) -> Complex:
    """Return the nearest of `things_m` (k x 2, {W}) from `place_m`, or `DIRECTIONS` if fewer than two are."""
    around = sorted((complex(x, y) - place_m for x, y in things_m), key=abs)
    away = [thing for thing in around if abs(thing) >= NEAREST_M][:MAX_THINGS]
    return np.array(away) if len(away) > 1 else DIRECTIONS


def right_probability(covariance: Array, things: Complex) -> float:
    """Return the mean probability that the ray at one of `things` (k) is nearest to that one.

    Args:
        covariance: 3 x 3, of x, y and yaw.
        things: relative to the place that is assumed, k.
    """
    values, vectors = np.linalg.eigh(covariance)
    errors = DRAWS @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    # from where the person stands, turned by the error of the yaw, cast from where they are assumed to stand
    rays: Complex = (things - (errors[:, :1] + 1j * errors[:, 1:2])) * np.exp(-1j * errors[:, 2:])
    rays /= np.maximum(np.abs(rays), 1e-9)
    cosines: Array = (
        np.stack([rays.real, rays.imag], axis=2) @ np.array([things.real, things.imag]) / np.abs(things)
    )
    own: Array = cosines.diagonal(axis1=1, axis2=2)
    needed: Array = np.clip(cosines.max(axis=2), math.cos(MAX_ANGLE_RAD), math.cos(MIN_ANGLE_RAD))
    return float(np.mean(own >= needed))
