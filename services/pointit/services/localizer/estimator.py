"""Where the person stands, from rays in {H} that were pointed at known places in {W} (pointing.md §4).

Robust least squares on angles for x, y, yaw and the person's own elevation bias, with the feet on the floor,
from several starts, because reflected poses are minima too.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from pointit.schemas import FARTHEST
from pointit.services.localizer.descent import Minima, Weights, descend, starts
from pointit.services.localizer.sphere import PARAMETERS, Array, Rays, residuals

COARSE_SAMPLES = 40
COARSE_ITERATIONS = 8
"""Samples and steps that suffice to tell the minima apart; the lowest are then refined with all samples.

Six steps found every minimum that 40 found, in 600 random rooms with 2 to 6 targets.
"""

RIVAL_COST = 10.0
"""A coarse minimum this far above the lowest one is not looked at again."""

MAX_BIAS_SIGMAS = 2.5
"""An elevation bias beyond it is no way of pointing, but of doing something else."""

AMBIGUOUS_COST = 2.0
"""Two refined minima whose costs differ by less (a factor e² in likelihood) cannot be told apart."""

GAP_S = 0.5
"""A longer pause between two samples is no time of pointing."""

SAME_POSE = 0.3
"""Metres and radians: poses nearer to each other are one."""

SAME_PLACE_M = 0.05
"""Targets closer together than this are one."""


@dataclass(frozen=True, kw_only=True)
class Trust:
    """What is believed before, and demanded after."""

    ray_sigma_rad: float = math.radians(2.0)
    """One sigma of one pointing, sideways and upwards alike."""
    bias_sigma_rad: float = math.radians(10.0)
    """One sigma of people's elevation bias."""
    body_sigma_m: float = 0.1
    """One sigma of where the eyes are over the feet; no number of rays tells."""
    independent_hz: float = 2.0
    """Independent pointings per second: the samples of one hold err together."""
    min_samples: int = 20
    max_residual_rad: float = math.radians(6.0)
    """Rms angle above which the person did not point at the targets."""
    max_position_sigma_m: float = 0.5
    max_yaw_sigma_rad: float = math.radians(6.0)


@dataclass(frozen=True)
class Pointings:
    """Rays and what they were pointed at, one row a sample, in order of time."""

    stamps_s: Array
    """n."""
    origins_m: Array
    """n x 3, {H}."""
    directions: Array
    """n x 3, unit, {H}."""
    targets_m: Array
    """n x 3, {W}."""

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.stamps_s)

    @property
    def span_s(self) -> float:
        """Return the time spent pointing, pauses taken out."""
        steps = np.diff(self.stamps_s)
        return float(np.sum(steps[(steps > 0.0) & (steps <= GAP_S)]))


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A pose that explains the pointings."""

    x_m: float
    y_m: float
    yaw_rad: float
    """Azimuth of {H}'s x axis in {W}, in [-π, π]."""
    bias_rad: float
    """How much higher than the targets the person's rays are."""
    covariance: Array
    """3 x 3, of x, y, yaw; inflated because the samples of a hold err together."""
    residual_rad: float
    """Rms angle between rays and targets."""
    samples: int

    @property
    def position_sigma_m(self) -> float:
        """Return one sigma along the worse horizontal direction."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    def is_near(self, other: "Solution") -> bool:
        """Return whether it makes no difference which of the two is taken."""
        away_m = math.hypot(self.x_m - other.x_m, self.y_m - other.y_m)
        turned_rad = abs(math.remainder(self.yaw_rad - other.yaw_rad, math.tau))
        return away_m <= SAME_POSE and turned_rad <= SAME_POSE

    @property
    def yaw_sigma_rad(self) -> float:
        """Return one sigma of the yaw."""
        return math.sqrt(float(self.covariance[2, 2]))


@dataclass(frozen=True)
class Refusal:
    """Why there is no pose."""

    reason: str
    """One sentence: what is wrong, what to do."""
    residual_rad: float | None = None


def solve(pointings: Pointings, trust: Trust | None = None, *, floor_m: float = 0.0) -> Solution | Refusal:
    """Return the pose whose view of the targets fits the rays best, or why none can be had.

    Args:
        pointings: at least `trust.min_samples`, at two or more places.
        trust: weights and limits.
        floor_m: height in {W} of the floor on which the person stands.
    """
    trust = trust if trust is not None else Trust()
    count = len(pointings)
    if count < trust.min_samples:
        return Refusal(f"only {count} rays were gathered and {trust.min_samples} are needed; see the IMU")
    targets = pointings.targets_m
    if float(np.max(np.ptp(targets, axis=0))) < SAME_PLACE_M:
        return Refusal("all pointing was at one place; point at two or more different ones")
    centre = np.array([*targets[:, :2].mean(axis=0), floor_m])  # numbers stay small wherever the origin is
    rays = Rays.of(pointings.origins_m, pointings.directions, targets - centre)
    weights = Weights(
        ray_sigma_rad=trust.ray_sigma_rad,
        bias_sigma_rad=trust.bias_sigma_rad,
        share=min(1.0, (1.0 + trust.independent_hz * pointings.span_s) / count),
    )
    every = max(1, count // COARSE_SAMPLES)
    coarse = descend(
        rays.some(every),
        starts(rays),
        replace(weights, share=min(1.0, weights.share * every)),
        COARSE_ITERATIONS,
    )
    minima = _sorted(descend(rays, _distinct(_sorted(coarse), RIVAL_COST), weights))
    if len(_distinct(minima, AMBIGUOUS_COST)) > 1:
        return Refusal("two places fit the pointing equally well; add a target in another direction")
    return _accepted(_solution(rays, minima, centre, trust), trust)


def _solution(rays: Rays, minima: Minima, centre: Array, trust: Trust) -> Solution:
    """Return the lowest minimum with its covariance, infinite where nothing is known."""
    pose = minima.poses[0]
    angles, _ = residuals(rays, pose[None])
    residual_rad = float(np.linalg.norm(angles)) / math.sqrt(len(rays.targets_m))
    excess = max(1.0, residual_rad / (math.sqrt(2.0) * trust.ray_sigma_rad))  # two angles a sample
    information: Array = minima.information[0]
    try:
        inverse = np.linalg.inv(information)
    except np.linalg.LinAlgError:
        inverse = np.diag(np.full(PARAMETERS, np.inf))
    covariance = inverse[:3, :3].astype(np.float64) * excess**2
    covariance = 0.5 * (covariance + covariance.T)
    covariance[[0, 1], [0, 1]] += trust.body_sigma_m**2
    return Solution(
        x_m=float(pose[0] + centre[0]),
        y_m=float(pose[1] + centre[1]),
        yaw_rad=math.remainder(float(pose[2]), math.tau),
        bias_rad=float(pose[3]),
        covariance=covariance,
        residual_rad=residual_rad,
        samples=len(rays.targets_m),
    )


def _accepted(solution: Solution, trust: Trust) -> Solution | Refusal:
    """Return `solution`, or why it is not good enough."""
    residual_rad = solution.residual_rad
    if residual_rad > trust.max_residual_rad:
        return Refusal(
            f"the rays miss the targets by {math.degrees(residual_rad):.1f}° and at most "
            f"{math.degrees(trust.max_residual_rad):.1f}° is accepted; point at each target, arm straight",
            residual_rad,
        )
    if abs(solution.bias_rad) > MAX_BIAS_SIGMAS * trust.bias_sigma_rad:
        return Refusal(
            f"the rays would lie {math.degrees(solution.bias_rad):+.0f}° too high all the time, which is no "
            "pointing; point at each target, arm straight",
            residual_rad,
        )
    covariance = solution.covariance
    if max(abs(solution.x_m), abs(solution.y_m)) > FARTHEST or residual_rad > FARTHEST:
        return Refusal("these rays meet nowhere in the world; point at each target, arm straight")
    if not np.all(np.isfinite(covariance)) or np.any(np.diag(covariance) <= 0.0):
        return Refusal("these targets do not tell the position; add a target elsewhere", residual_rad)
    position_m, yaw_rad = solution.position_sigma_m, solution.yaw_sigma_rad
    if position_m > trust.max_position_sigma_m or yaw_rad > trust.max_yaw_sigma_rad:
        return Refusal(
            f"the pose is uncertain by {position_m:.2f} m and {math.degrees(yaw_rad):.1f}° and at most "
            f"{trust.max_position_sigma_m:.2f} m, {math.degrees(trust.max_yaw_sigma_rad):.1f}° are accepted; "
            "point longer or at one more target, below the waist or far to the side",
            residual_rad,
        )
    return solution


def _sorted(minima: Minima) -> Minima:
    order = np.argsort(minima.costs)
    return Minima(minima.poses[order], minima.costs[order], minima.information[order])


def _distinct(minima: Minima, margin: float) -> Array:
    """Return the poses (k x 4) of sorted `minima` up to `margin` above the lowest, each place once."""
    kept: list[Array] = []
    for pose in minima.poses[minima.costs <= minima.costs[0] + margin]:
        steps = [np.abs(pose[:3] - other[:3]) for other in kept]
        if all(
            max(step[0], step[1]) > SAME_POSE or abs(math.remainder(step[2], math.tau)) > SAME_POSE
            for step in steps
        ):
            kept.append(pose)
    return np.array(kept)
