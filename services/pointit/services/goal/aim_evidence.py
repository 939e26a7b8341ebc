"""Likelihoods of the rays of some seconds if a person points at each robot, and at none.

Errors that last (place, yaw, aim, elevation bias, latency of the tracker) are common to all rays of the
window: they are integrated out, so a robot that moves, and is followed, differs from one that merely lies
near the ray.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.schemas import NS_PER_S

Array = NDArray[np.float64]

NO_TARGET_RAD = np.array([1.8, 0.5])
"""1 sigma of the direction of a ray at no robot: about its mean azimuth, and `DOWNWARDS_RAD`."""

DOWNWARDS_RAD = math.radians(-15.0)
"""Mean elevation of rays at no robot."""


@dataclass(frozen=True, kw_only=True)
class IdentificationSettings:
    """Errors of people who point, and limits."""

    window_s: float = 3.0
    block_s: float = 0.25
    """Rays of this time count as one measurement."""
    ray_sigma_rad: float = math.radians(2.0)
    """Standard deviation of the error of a block that changes within a pointing."""
    correlation_s: float = 0.5
    """Correlation time of that error."""
    scales: tuple[float, ...] = (0.5, 1.0, 2.0)
    """Factors on that error, equally probable: steady and restless people."""
    aim_sigma_rad: float = math.radians(5.0)
    """Standard deviation of the constant error of one pointing, sideways (pointing.md §7: 4 to 6 degrees)."""
    bias_sigma_rad: float = math.radians(4.0)
    """The same upwards."""
    body_sigma_m: float = 0.1
    """Standard deviation of the eyes' position over the feet."""
    height_sigma_m: float = 0.05
    latency_sigma_s: float = 0.15
    """Standard deviation of the delay between rays and reports: the person's lag, and the tracker's."""
    walks_rad: tuple[float, ...] = (0.0, math.radians(10.0), math.radians(40.0))
    """Movement of an arm that points at no robot: standard deviation after 1 s, equally probable."""
    began_s: tuple[float, ...] = (3.0, 2.0, 1.0, 0.5)
    """Times since which the person may have pointed at the present target, the longest first."""
    began_odds: tuple[float, ...] = (0.4, 0.2, 0.2, 0.2)
    none_prior: float = 0.5
    """Probability that the person points at no robot, before any ray."""
    beside_share: float = 0.8
    """Share of it that is of places beside robots, where people want one to go."""
    beside_sigma_m: float = 1.0
    """Standard deviation of such a place about a robot, per axis on the floor."""
    chosen: float = 0.9
    """Probability from which a robot is chosen."""
    stale_s: float = 1.0
    """Robots whose newest report is older are no candidates, and rays older than this identify none."""


@dataclass(frozen=True)
class RayBlocks:
    """Means of rays, one row a block, in {W}."""

    times_ns: NDArray[np.int64]
    eyes_m: Array
    """n x 3."""
    angles: Array
    """n x 2: azimuth, unwrapped, and elevation, rad."""

    @property
    def ages_s(self) -> Array:
        """Return the times before the newest block."""
        return np.asarray((self.times_ns[-1] - self.times_ns) / NS_PER_S, dtype=np.float64)


def log_likelihoods(
    blocks: RayBlocks, missed: Array, spreads: Array, settings: IdentificationSettings
) -> Array:
    """Return the log likelihoods (k + 1) of the rays if they are at each robot, and at none.

    The person may have begun to point at it within the window; before, they pointed at nothing in particular.

    Args:
        blocks: n.
        missed: k x 2n, angles to the robots: all sideways ones, then all upwards.
        spreads: k x 2n x 2n, the covariances of their lasting errors.
        settings: errors of people.
    """
    ages = blocks.ages_s
    centre = np.array([blocks.angles[:, 0].mean(), DOWNWARDS_RAD])
    no_target = (blocks.angles - centre).T.ravel()
    noise = _of_both_axes(_correlated(ages, settings))
    constant = np.kron(np.diag(NO_TARGET_RAD**2), np.ones((len(ages), len(ages))))
    walked = _of_both_axes(np.minimum.outer(ages, ages))
    roams = constant + np.square(settings.walks_rad)[:, None, None] * walked
    logs = list[Array]()
    for began_s, odds in zip(settings.began_s, settings.began_odds, strict=True):
        late = np.flatnonzero(np.tile(ages <= began_s, 2))
        early = np.flatnonzero(np.tile(ages > began_s, 2))
        robots = [
            _log_density(miss[late], _part(spread, late), _part(noise, late), settings.scales)
            for miss, spread in zip(missed, spreads, strict=True)
        ]
        none = _at_none(no_target[late], _part(roams, late), _part(noise, late), settings)
        if len(early):
            before = _at_none(no_target[early], _part(roams, early), _part(noise, early), settings)
        else:
            before = 0.0
        logs.append(math.log(odds) + before + np.array([*robots, none]))
    return np.asarray(np.logaddexp.reduce(np.stack(logs)), dtype=np.float64)


def _part(matrices: Array, rows: NDArray[np.intp]) -> Array:
    return np.asarray(matrices[..., rows[:, None], rows], dtype=np.float64)


def _of_both_axes(matrix: Array) -> Array:
    """Return the covariance (2n x 2n) of independent errors on both axes, each of `matrix` (n x n)."""
    return np.asarray(np.kron(np.eye(2), matrix), dtype=np.float64)


def _correlated(ages: Array, settings: IdentificationSettings) -> Array:
    """Return the covariance (n x n) of errors that change within a pointing."""
    apart = np.abs(ages[:, None] - ages)
    return np.asarray(settings.ray_sigma_rad**2 * np.exp(-apart / settings.correlation_s), dtype=np.float64)


def _at_none(angles: Array, roams: Array, noise: Array, settings: IdentificationSettings) -> float:
    """Return the log density of `angles` of an arm that stays, or moves at any of the rates."""
    logs = [_log_density(angles, roam, noise, settings.scales) for roam in roams]
    return float(np.logaddexp.reduce(logs)) - math.log(len(logs))


def _log_density(values: Array, spread: Array, noise: Array, scales: Sequence[float]) -> float:
    """Return the log density of `values` with normal errors: `spread`, and `noise` times any of `scales`."""
    covariances = spread + np.square(scales)[:, None, None] * noise
    roots = np.linalg.cholesky(covariances)
    whitened = np.linalg.solve(roots, np.broadcast_to(values, (len(roots), len(values)))[..., None])[..., 0]
    sizes = np.log(np.einsum("kii->ki", roots)).sum(axis=1)
    logs = -0.5 * np.square(whitened).sum(axis=1) - sizes
    return float(np.logaddexp.reduce(logs)) - math.log(len(scales)) - 0.5 * len(values) * math.log(math.tau)
