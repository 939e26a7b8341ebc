"""Angles between measured rays and the directions of the targets from a pose, and their derivatives.

Everything is batched over poses (k) and samples (n), since the solver evaluates several poses at once. The
horizontal plane is complex, so that rotations are products.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

PARAMETERS = 5
"""x (m), y (m) and yaw (rad) of {H} in {W}; elevation bias (rad) of the person's rays; z (m) of {H} above the
floor, or the error of the eye height from the body measures.
"""

PLUMB_RAD = 0.5 * math.pi - 1e-6
"""Rays steeper than this have no azimuth."""

_TINY = 1e-9


@dataclass(frozen=True)
class Rays:
    """Measurements, one row a sample: rays in {H}, targets in {W}, both relative to the floor."""

    origins_m: Array
    """n x 3."""
    azimuths_rad: Array
    elevations_rad: Array
    targets_m: Array
    """n x 3."""

    @classmethod
    def of(cls, origins_m: Array, directions: Array, targets_m: Array) -> "Rays":
        """Return the rays with `directions` (n x 3) of any length."""
        level = np.hypot(directions[:, 0], directions[:, 1])
        azimuths = np.arctan2(directions[:, 1], directions[:, 0])
        elevations = np.arctan2(directions[:, 2], level)
        # vertical rays have no azimuth but that of rounding: use any that turns with the others
        azimuths[np.abs(elevations) > PLUMB_RAD] = azimuths[np.argmin(np.abs(elevations))]
        return cls(origins_m, azimuths, elevations, targets_m)

    @cached_property
    def inverse_azimuth(self) -> Complex:
        """Return the rotations (n) of the rays into the forward direction."""
        turn: Complex = np.exp(-1j * self.azimuths_rad)
        return turn

    @cached_property
    def elevation_phasor(self) -> Complex:
        """Return cos + i sin of each elevation, n."""
        turn: Complex = np.exp(1j * self.elevations_rad)
        return turn

    @cached_property
    def targets(self) -> Complex:
        """Return the targets in the horizontal plane, n."""
        return np.asarray(self.targets_m[:, 0] + 1j * self.targets_m[:, 1], dtype=np.complex128)

    @cached_property
    def origins(self) -> Complex:
        """Return the origins in the horizontal plane, each with its ray turned forward, n."""
        return np.asarray((self.origins_m[:, 0] + 1j * self.origins_m[:, 1]) * self.inverse_azimuth)

    @cached_property
    def heights(self) -> Array:
        """Return the heights (n) of the targets above the origins."""
        return np.asarray(self.targets_m[:, 2] - self.origins_m[:, 2], dtype=np.float64)


def angular_errors(rays: Rays, poses: Array) -> tuple[Array, Array]:
    """Return the residual angles without derivatives: to the left of the rays and above them, k x n each."""
    turn = np.exp(-1j * poses[:, 2])[:, None] * rays.inverse_azimuth
    flat = (rays.targets - (poses[:, 0] + 1j * poses[:, 1])[:, None]) * turn - rays.origins
    up = rays.heights - poses[:, 4, None]
    tilt = rays.elevation_phasor * np.exp(-1j * poses[:, 3])[:, None]
    ahead, left = flat.real, flat.imag
    along = tilt.real * ahead + tilt.imag * up
    above = tilt.real * up - tilt.imag * ahead
    gain = 2.0 / np.maximum(np.sqrt(left * left + ahead * ahead + up * up) + along, _TINY)
    return np.asarray(gain * left, dtype=np.float64), np.asarray(gain * above, dtype=np.float64)


def residuals(rays: Rays, poses: Array) -> tuple[Array, Array]:
    """Return the angles between targets and rays, and their derivatives by the pose.

    The residual is the stereographic projection onto the tangent plane of the measured ray, its elevation
    lowered by the bias. Its length is 2 tan(angle / 2): the angle within 1 % up to 20 degrees, regular for
    vertical rays, unlike azimuths, and growing the further behind a target is.

    Args:
        rays: n samples.
        poses: k x 5, see `PARAMETERS`.

    Returns:
        k x 2 x n angles, rad (to the left of the ray, above it), and their k x 5 x 2 x n derivatives.
    """
    place: Complex = (poses[:, 0] + 1j * poses[:, 1])[:, None]
    turns = np.exp(-1j * poses[:, 2:4])
    turn = turns[:, :1] * rays.inverse_azimuth
    seen = (rays.targets - place) * turn
    flat = seen - rays.origins
    ahead, left = flat.real, flat.imag
    up = rays.heights - poses[:, 4, None]
    tilt = rays.elevation_phasor * turns[:, 1:]
    cos_el, sin_el = tilt.real, tilt.imag
    along = cos_el * ahead + sin_el * up
    above = cos_el * up - sin_el * ahead
    reach = np.sqrt(left * left + ahead * ahead + up * up)
    gain = 2.0 / np.maximum(reach + along, _TINY)
    out = np.empty((len(poses), 2, left.shape[1]))
    out[:, 0], out[:, 1] = gain * left, gain * above

    # derivatives of (left, above, along + reach) by each parameter, then of the quotients
    d_flat = np.empty((len(poses), 3, left.shape[1]), dtype=np.complex128)
    d_flat[:, 0], d_flat[:, 1], d_flat[:, 2] = -turn, -1j * turn, -1j * seen
    d_ahead, d_left = d_flat.real, d_flat.imag
    slope = np.zeros((len(poses), PARAMETERS, 2, left.shape[1]))
    slope[:, :3, 0], slope[:, :3, 1] = d_left, -sin_el[:, None] * d_ahead
    slope[:, 3, 1], slope[:, 4, 1] = along, -cos_el
    d_reach = np.empty((len(poses), PARAMETERS, left.shape[1]))
    far = np.maximum(reach, _TINY)
    d_reach[:, :3] = (left[:, None] * d_left + ahead[:, None] * d_ahead) / far[:, None]
    d_reach[:, :3] += cos_el[:, None] * d_ahead
    d_reach[:, 3], d_reach[:, 4] = -above, -up / far - sin_el
    slope -= (0.5 * out)[:, None] * d_reach[:, :, None]
    slope *= gain[:, None, None]
    return out, slope
