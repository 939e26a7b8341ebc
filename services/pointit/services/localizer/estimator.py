"""Where the person stands, from rays in {H} that were pointed at known places in {W} (pointing.md §4).

Maximum a posteriori on angles for x, y, yaw, the person's own elevation bias and, within what body measures
leave open, the height of the eyes, the feet on the floor; from many starts, because reflected poses are
minima too. The weights are those of the unrest within a hold, one measurement each 0.15 s: what errs all
hold long goes into yaw and bias, and weighing it heavier made recorded people's places worse. How sure the
pose is comes from `certainty`, where all of the errors count.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from pointit.schemas import FARTHEST
from pointit.services.localizer.blocks import GAP_S, Blocks, Pointings, blocks
from pointit.services.localizer.certainty import Doubt, covariance, independent
from pointit.services.localizer.descent import SAME_POSE, Weights, costs_of, descend, starts
from pointit.services.localizer.sphere import Array, Rays, misses

__all__ = ["AMBIGUOUS_COST", "GAP_S", "Pointings", "Refusal", "Solution", "Trust", "solve"]

AMBIGUOUS_COST = 2.0
"""Two refined minima whose costs differ by less (a factor e² in likelihood) cannot be told apart."""

NEGLIGIBLE = 1e-3
"""A place less probable than this is left out of the uncertainty."""

SAME_PLACE_M = 0.05
"""Targets closer together than this are one."""

SAME_VIEW_RAD = math.radians(2.0)
"""Rays that stay within this have one direction."""

LEVEL_M = 0.1
"""Targets within this of the height of the eyes are seen level."""


@dataclass(frozen=True, kw_only=True)
class Trust:
    """What is believed before, and demanded after."""

    ray_sigma_rad: float = math.radians(2.0)
    """One sigma sideways of the rays that follow something (pointing.md §1: 1.8 to 3.8 degrees both ways)."""
    elevation_sigma_rad: float = math.radians(3.0)
    """The same upwards: the elevation hangs on body measures, the azimuth does not."""
    act_sigma_rad: float = math.radians(5.0)
    """One sigma sideways of one pointing at a thing that stands still (§7: 4 to 6 degrees)."""
    bias_sigma_rad: float = math.radians(10.0)
    """One sigma of people's elevation bias."""
    body_sigma_m: float = 0.1
    """One sigma of where the eyes are over the feet; no number of rays tells."""
    height_sigma_m: float = 0.05
    """One sigma of the height of the eyes over the floor; a large one leaves it free."""
    model_sigma_rad: float = 0.1
    """One sigma of a ray's constant error: eyes or finger 7 cm beside the model, over an arm of 0.7 m."""
    independent_hz: float = 2.0
    """Independent pointings per second of following; a hold at a thing that stands still is one."""
    min_samples: int = 20
    max_residual_rad: float = math.radians(9.0)
    """Rms angle above which the person did not follow what moved."""
    max_act_residual_rad: float = math.radians(12.0)
    """The same of pointing at what stood still."""
    bias_sigma_limit: float = 2.5
    """Sigmas of the elevation bias beyond which it is no way of pointing, but of doing something else."""
    max_position_sigma_m: float = 0.7
    max_yaw_sigma_rad: float = math.radians(12.0)

    def weights(self) -> Weights:
        """Return what the descent needs of it."""
        prior = np.zeros(5)
        prior[3], prior[4] = self.bias_sigma_rad**-2, max(self.height_sigma_m, 1e-4) ** -2
        return Weights(sigma_rad=np.array([[self.ray_sigma_rad], [self.elevation_sigma_rad]]), prior=prior)

    def doubt(self, *, is_still: bool) -> Doubt:
        """Return what is believed about errors, the targets standing still or not."""
        sideways = self.act_sigma_rad if is_still else self.ray_sigma_rad
        return Doubt(
            sigma_rad=np.array([sideways, self.elevation_sigma_rad]),
            independent_hz=0.0 if is_still else self.independent_hz,  # a reach errs until the next one
            body_sigma_m=self.body_sigma_m,
            model_sigma_rad=self.model_sigma_rad,
        )

    def residual_limit_rad(self, *, is_still: bool) -> float:
        """Return the rms angle above which nobody pointed, the targets standing still or not."""
        return self.max_act_residual_rad if is_still else self.max_residual_rad


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
    """3 x 3, of x, y, yaw: what the rays cannot know is in it, and other places that fit about as well.

    The yaw is that of pointing: an error that turns all of a person's rays alike is in it, and harmless.
    """
    residual_rad: float
    """Rms angle between rays and targets."""
    samples: int
    z_m: float = 0.0
    """How much higher the eyes are than the body measures say; the floor's height if that was left free."""
    z_sigma_m: float = 0.0
    bias_sigma_rad: float = 0.0
    rival: float = 0.0
    """Probability that the person stands at another place that fits, too."""

    @property
    def position_sigma_m(self) -> float:
        """Return one sigma along the worse horizontal direction."""
        (xx, xy), (_, yy) = self.covariance[:2, :2].tolist()
        return math.sqrt(max(0.0, 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)))

    def is_near(self, other: "Solution") -> bool:
        """Return whether it makes no difference which of the two is taken."""
        away_m = math.hypot(self.x_m - other.x_m, self.y_m - other.y_m)
        turned_rad = abs(math.remainder(self.yaw_rad - other.yaw_rad, math.tau))
        return away_m <= SAME_POSE and turned_rad <= SAME_POSE

    @property
    def yaw_sigma_rad(self) -> float:
        """Return one sigma of the yaw."""
        return math.sqrt(max(0.0, float(self.covariance[2, 2])))


@dataclass(frozen=True)
class Refusal:
    """Why there is no pose."""

    reason: str
    """One sentence: what is wrong, what to do."""
    residual_rad: float | None = None


def solve(
    pointings: Pointings,
    trust: Trust | None = None,
    *,
    floor_m: float = 0.0,
    start: Solution | None = None,
) -> Solution | Refusal:
    """Return the pose whose view of the targets fits the rays best, or why none can be had.

    Args:
        pointings: at least `trust.min_samples`, at two or more places.
        trust: weights and limits.
        floor_m: height in {W} of the floor on which the person stands.
        start: a pose found before, to begin from besides.
    """
    trust = trust if trust is not None else Trust()
    count = len(pointings)
    if count < trust.min_samples:
        return Refusal(f"only {count} rays were gathered and {trust.min_samples} are needed; see the IMU")
    targets = pointings.targets_m
    if float(np.max(np.ptp(targets, axis=0))) < SAME_PLACE_M:
        return Refusal("all pointing was at one place; point at two or more different ones")
    summary = blocks(pointings)
    means = summary.pointings
    centre = np.array([*targets[:, :2].mean(axis=0), floor_m])  # numbers stay small wherever the origin is
    rays = Rays.of(means.origins_m, means.directions, means.targets_m - centre)
    weights = trust.weights()
    first = starts(rays, weights)
    if start is not None:
        first = np.vstack([first, _pose_of(start, centre)])
    minima = descend(rays, first, weights)
    solution = _solution(rays, summary, minima.poses, trust)
    exact = Rays.of(pointings.origins_m, pointings.directions, targets - centre)
    solution = replace(
        solution,
        x_m=float(solution.x_m + centre[0]),
        y_m=float(solution.y_m + centre[1]),
        residual_rad=_missing_rad(exact, minima.poses[0]),
        samples=count,
    )
    return _accepted(solution, rays, trust, trust.residual_limit_rad(is_still=summary.is_still))


def _solution(rays: Rays, summary: Blocks, poses: Array, trust: Trust) -> Solution:
    """Return the likeliest of `poses`, about the centre; the others that fit, too, are in its covariance."""
    weights, doubt = trust.weights(), trust.doubt(is_still=summary.is_still)
    worth = independent(summary, doubt.independent_hz)
    costs = costs_of(rays, poses, replace(weights, sigma_rad=doubt.sigma_rad), worth)
    odds: Array = np.exp(costs.min() - costs)
    odds /= odds.sum()
    best = poses[0]
    spread = np.zeros((len(best), len(best)))
    for pose, share in zip(poses[odds >= NEGLIGIBLE], odds[odds >= NEGLIGIBLE], strict=True):
        off = pose - best
        off[2] = math.remainder(float(off[2]), math.tau)
        spread += share * (covariance(rays, pose, worth, weights, doubt) + np.outer(off, off))
    sigma = np.sqrt(np.maximum(np.diag(spread), 0.0))
    return Solution(
        x_m=float(best[0]),
        y_m=float(best[1]),
        yaw_rad=math.remainder(float(best[2]), math.tau),
        bias_rad=float(best[3]),
        covariance=spread[:3, :3],
        residual_rad=0.0,
        samples=0,
        z_m=float(best[4]),
        z_sigma_m=float(sigma[4]),
        bias_sigma_rad=float(sigma[3]),
        rival=float(1.0 - odds[0]),
    )


def _missing_rad(rays: Rays, pose: Array) -> float:
    """Return the rms angle between `rays` and the targets as `pose` (5) would see them."""
    left, above = misses(rays, pose[None])
    exact: Array = 2.0 * np.arctan(0.5 * np.hypot(left, above))
    return math.sqrt(float(np.mean(exact * exact)))


def _accepted(solution: Solution, rays: Rays, trust: Trust, limit_rad: float) -> Solution | Refusal:
    """Return `solution`, or why it is not good enough."""
    residual_rad = solution.residual_rad
    if max(abs(solution.x_m), abs(solution.y_m)) > FARTHEST or not math.isfinite(residual_rad):
        return Refusal("these rays meet nowhere in the world; point at each target, arm straight")
    if residual_rad > limit_rad:
        return Refusal(_missed(residual_rad, rays, limit_rad), residual_rad)
    if abs(solution.bias_rad) > trust.bias_sigma_limit * trust.bias_sigma_rad:
        return Refusal(
            f"the rays would lie {math.degrees(solution.bias_rad):+.0f}° too high all the time, which is no "
            "pointing; point at each target, arm straight",
            residual_rad,
        )
    position_m, yaw_rad = solution.position_sigma_m, solution.yaw_sigma_rad
    if position_m > trust.max_position_sigma_m or yaw_rad > trust.max_yaw_sigma_rad:
        return Refusal(_unsure(solution, rays, trust), residual_rad)
    return solution


def _missed(residual_rad: float, rays: Rays, limit_rad: float) -> str:
    """Return what is wrong with rays that miss the targets."""
    if _is_one_view(rays):
        return (
            "the arm was held in one direction while there were several targets; "
            "point at each target, arm straight, until it changes"
        )
    return (
        f"the rays miss the targets by {math.degrees(residual_rad):.1f}° and at most "
        f"{math.degrees(limit_rad):.1f}° is accepted; point at each target, arm straight"
    )


def _unsure(solution: Solution, rays: Rays, trust: Trust) -> str:
    """Return why the pose is not certain enough, and what would make it so."""
    stated = (
        f"the pose is uncertain by {min(solution.position_sigma_m, 99.0):.2f} m and "
        f"{min(math.degrees(solution.yaw_sigma_rad), 180.0):.1f}° and at most "
        f"{trust.max_position_sigma_m:.2f} m, {math.degrees(trust.max_yaw_sigma_rad):.1f}° are accepted"
    )
    if _is_one_view(rays):
        return f"{stated}: the targets lie in one direction; add one far to the side"
    if float(np.max(np.abs(rays.heights))) < LEVEL_M:
        return f"{stated}: all targets are at the height of the eyes; add one below the waist"
    if solution.rival > 1.0 / (1.0 + math.exp(AMBIGUOUS_COST)):
        return f"{stated}: two places fit the pointing equally well; add a target in another direction"
    return f"{stated}; point longer or at one more target, below the waist or far to the side"


def _is_one_view(rays: Rays) -> bool:
    """Return whether all rays have one direction."""
    turned = np.angle(rays.back * np.conj(rays.back[0]))
    spread = float(np.ptp(turned)) * float(np.min(rays.tilt.real))
    return spread < SAME_VIEW_RAD and float(np.ptp(rays.elevations_rad)) < SAME_VIEW_RAD


def _pose_of(solution: Solution, centre: Array) -> Array:
    place = [solution.x_m - centre[0], solution.y_m - centre[1]]
    return np.array([*place, solution.yaw_rad, solution.bias_rad, solution.z_m])
