"""Pose of the person from rays in {H} that were pointed at known places in {W} (pointing.md §4).

Maximum a posteriori estimate from angles, of x, y, yaw, the person's elevation bias and, within the
uncertainty of body measures, the eye height, with the feet on the floor. It starts from many poses because
reflected poses are minima, too. The weights are those of the tremor within a hold, one measurement each
0.15 s: an error that lasts a whole hold goes into yaw and bias, and weighing it heavier made positions of
recorded people worse. The covariance comes from `uncertainty`, where all errors count.
"""

import math
from dataclasses import replace

import numpy as np

from pointit.services.localizer.estimation.acceptance import AMBIGUOUS_COST, NOWHERE, check_solution, untimely
from pointit.services.localizer.estimation.angular_residuals import Array, Rays, angular_errors
from pointit.services.localizer.estimation.levenberg_marquardt import evaluate_costs, initial_poses, minimize
from pointit.services.localizer.estimation.sample_blocks import GAP_S, Blocks, Pointings, blocks
from pointit.services.localizer.estimation.solution import Refusal, Solution, SolverSettings
from pointit.services.localizer.estimation.uncertainty import covariance, effective_samples

__all__ = ["AMBIGUOUS_COST", "GAP_S", "Pointings", "Refusal", "Solution", "SolverSettings", "solve"]

NEGLIGIBLE = 1e-3
"""Poses less probable than this are left out of the covariance."""

NEAREST_M = 0.4
"""Smallest distance from the eyes to a target of a straight arm."""

TRIMMED = 0.1
"""Share of the samples, the worst, that may be outliers."""

LESS = math.sqrt(1.0 + TRIMMED * math.log(TRIMMED) / (1.0 - TRIMMED))
"""Ratio of the others' rms to that of all, for normal errors on both axes (exponential squares)."""

SAME_PLACE_M = 0.05
"""Targets closer together than this count as one."""


def solve(
    pointings: Pointings,
    trust: SolverSettings | None = None,
    *,
    floor_m: float = 0.0,
    start: Solution | None = None,
) -> Solution | Refusal:
    """Return the pose that fits the rays best, or the refusal if there is none.

    Outliers have less weight (Huber) and must not decide either: rays that miss the targets by too much are
    solved once more without the worst tenth of them.

    Args:
        pointings: at least `trust.min_samples`, at two or more places.
        trust: weights and limits.
        floor_m: height in {W} of the floor on which the person stands.
        start: a pose found before, used as an additional start.
    """
    trust = trust if trust is not None else SolverSettings()
    count = len(pointings)
    if count < trust.min_samples:
        return Refusal(f"only {count} rays were gathered and {trust.min_samples} are needed; check the IMU")
    targets = pointings.targets_m
    spread_m = np.ptp(targets, axis=0)
    if float(spread_m.max()) < SAME_PLACE_M:
        return Refusal("all pointing was at one place; point at two or more different ones")
    if float(spread_m[:2].max()) < SAME_PLACE_M:
        return Refusal("all targets are above one another, so the direction is open; add one to the side")
    summary = blocks(pointings)
    means = summary.pointings
    centre = np.array([*targets[:, :2].mean(axis=0), floor_m])  # keeps numbers small wherever the origin is
    rays = Rays.of(means.origins_m, means.directions, means.targets_m - centre)
    weights = trust.weights()
    first = initial_poses(rays, weights)
    if start is not None:
        first = np.vstack([first, _pose_of(start, centre)])
    poses = _out_of_reach(rays, minimize(rays, first, weights).poses)
    if not len(poses):
        return Refusal(NOWHERE)
    solution = _solution(rays, summary, poses, trust)
    missed = _missed_rad(Rays.of(pointings.origins_m, pointings.directions, targets - centre), poses[0])
    residual_rad = math.sqrt(float(np.mean(missed * missed)))
    limit_rad = trust.residual_limit_rad(is_still=summary.is_still)
    if residual_rad > limit_rad and trust.trims:
        kept = missed <= np.quantile(missed, 1.0 - TRIMMED)
        again = solve(pointings.only(kept), trust.trimmed(LESS), floor_m=floor_m, start=start)
        if isinstance(again, Solution):
            return again
    solution = replace(
        solution,
        x_m=float(solution.x_m + centre[0]),
        y_m=float(solution.y_m + centre[1]),
        residual_rad=residual_rad,
        samples=count,
    )
    place_m = (float(poses[0, 0]), float(poses[0, 1]))
    result = check_solution(solution, place_m, rays, trust, limit_rad)
    if isinstance(result, Refusal) and solution.late.any():
        timely = replace(solution, covariance=solution.covariance - solution.late)
        if isinstance(check_solution(timely, place_m, rays, trust, limit_rad), Solution):
            return Refusal(untimely(solution, trust), result.residual_rad)
    return result


def _out_of_reach(rays: Rays, poses: Array) -> Array:
    """Return those of `poses` (k x 5) in which no target is nearer to the eyes than `NEAREST_M`."""
    turned = np.exp(1j * poses[:, 2])[:, None] * (rays.origins * np.conj(rays.inverse_azimuth))
    level = np.abs(rays.targets - (poses[:, 0] + 1j * poses[:, 1])[:, None] - turned)
    nearest = np.hypot(level, rays.heights - poses[:, 4, None]).min(axis=1)
    return np.asarray(poses[nearest >= NEAREST_M], dtype=np.float64)


def _solution(rays: Rays, summary: Blocks, poses: Array, trust: SolverSettings) -> Solution:
    """Return the likeliest of `poses` about the centre; its covariance includes the alternatives."""
    weights, noise = trust.weights(), trust.noise_model(is_still=summary.is_still)
    sample_weights = effective_samples(summary, noise.independent_hz)
    costs = evaluate_costs(rays, poses, replace(weights, sigma_rad=noise.sigma_rad), sample_weights)
    odds: Array = np.exp(costs.min() - costs)
    odds /= odds.sum()
    best = poses[0]
    spread, late = np.zeros((2, len(best), len(best)))
    for pose, share in zip(poses[odds >= NEGLIGIBLE], odds[odds >= NEGLIGIBLE], strict=True):
        off = pose - best
        off[2] = math.remainder(float(off[2]), math.tau)
        found, of_latency = covariance(
            rays, pose, sample_weights, weights, noise, velocities_mps=summary.velocities_mps
        )
        spread += share * (found + np.outer(off, off))
        late += share * of_latency
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
        alternative=float(1.0 - odds[0]),
        late=late[:3, :3],
    )


def _missed_rad(rays: Rays, pose: Array) -> Array:
    """Return the angles (n) between `rays` and the targets as seen from `pose` (5)."""
    left, above = angular_errors(rays, pose[None])
    return np.asarray(2.0 * np.arctan(0.5 * np.hypot(left, above)), dtype=np.float64).ravel()


def _pose_of(solution: Solution, centre: Array) -> Array:
    place = [solution.x_m - centre[0], solution.y_m - centre[1]]
    return np.array([*place, solution.yaw_rad, solution.bias_rad, solution.z_m])
