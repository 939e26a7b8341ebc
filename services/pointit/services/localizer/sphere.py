"""Angles between measured rays and the directions in which a pose would see the targets, and their slopes.

Everything is batched over poses (k) and samples (n): the solver tries several poses at once.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PARAMETERS = 4
"""x (m), y (m) of {H} in {W}; yaw (rad) of {H} in {W}; elevation bias (rad) of the person's rays."""


@dataclass(frozen=True)
class Rays:
    """What was measured, one row a sample: rays in {H}, targets in {W}, both relative to the floor."""

    origins_m: Array
    """n x 3."""
    azimuths_rad: Array
    elevations_rad: Array
    targets_m: Array
    """n x 3."""

    @classmethod
    def of(cls, origins_m: Array, directions: Array, targets_m: Array) -> "Rays":
        """Return the rays with unit `directions` (n x 3)."""
        level = np.hypot(directions[:, 0], directions[:, 1])
        return cls(
            origins_m,
            np.arctan2(directions[:, 1], directions[:, 0]),
            np.arctan2(directions[:, 2], level),
            targets_m,
        )

    def some(self, every: int) -> "Rays":
        """Return each `every`-th sample."""
        return Rays(
            self.origins_m[::every],
            self.azimuths_rad[::every],
            self.elevations_rad[::every],
            self.targets_m[::every],
        )


def residuals(rays: Rays, poses: Array) -> tuple[Array, Array]:
    """Return how far the targets are from the rays, and how that changes with the pose.

    The residual is the logarithmic map in the tangent plane of the measured ray, its elevation lowered by
    the bias: its norm is the angle, so that it is regular straight up and down, where azimuths are not.

    Args:
        rays: n samples.
        poses: k x 4, see `PARAMETERS`.

    Returns:
        k x 2 x n angles, rad (to the left of the ray, above it), and their k x 4 x 2 x n derivatives.
    """
    x, y, yaw, bias = (poses[:, i, None] for i in range(PARAMETERS))
    cos_yaw, sin_yaw = np.cos(yaw), np.sin(yaw)
    dx, dy = rays.targets_m[:, 0] - x, rays.targets_m[:, 1] - y
    seen_x, seen_y = cos_yaw * dx + sin_yaw * dy, cos_yaw * dy - sin_yaw * dx
    # in {H} turned so that the ray lies in the x-z plane: forward, to the left, up
    cos_az, sin_az = np.cos(rays.azimuths_rad), np.sin(rays.azimuths_rad)
    east, north = seen_x - rays.origins_m[:, 0], seen_y - rays.origins_m[:, 1]
    ahead = cos_az * east + sin_az * north
    left = cos_az * north - sin_az * east
    up = rays.targets_m[:, 2] - rays.origins_m[:, 2]
    elevation = rays.elevations_rad - bias
    cos_el, sin_el = np.cos(elevation), np.sin(elevation)
    along = cos_el * ahead + sin_el * up
    above = cos_el * up - sin_el * ahead

    square = np.maximum(left * left + above * above, 1e-18)
    across = np.sqrt(square)
    gain = np.arctan2(across, along) / across
    whole = square + along * along
    bend = (along / whole - gain) / square
    limit = -2.0 / 3.0 / np.maximum(np.abs(along), 1e-9) ** 3  # used only where `along` is far more than that
    bend = np.where(square < 1e-8 * whole, limit, bend)  # free of noise
    out = np.stack([gain * left, gain * above], axis=1)

    # derivatives of (left, above, along) by each parameter, then the chain rule
    turn = yaw + rays.azimuths_rad
    cos_turn, sin_turn = np.cos(turn), np.sin(turn)
    d_left = np.stack(
        [sin_turn, -cos_turn, -(cos_az * seen_x + sin_az * seen_y), np.zeros_like(turn)], axis=1
    )
    d_ahead = np.stack([-cos_turn, -sin_turn, cos_az * seen_y - sin_az * seen_x, np.zeros_like(turn)], axis=1)
    d_above = -sin_el[:, None] * d_ahead
    d_along = cos_el[:, None] * d_ahead
    d_above[:, 3] = along
    d_along[:, 3] = -above
    by_left = bend * left
    by_above = bend * above
    mixed = by_left * above
    slope = np.empty((len(poses), PARAMETERS, 2, left.shape[1]))
    slope[:, :, 0] = (
        (gain + by_left * left)[:, None] * d_left
        + mixed[:, None] * d_above
        - (left / whole)[:, None] * d_along
    )
    slope[:, :, 1] = (
        (gain + by_above * above)[:, None] * d_above
        + mixed[:, None] * d_left
        - (above / whole)[:, None] * d_along
    )
    return out, slope
