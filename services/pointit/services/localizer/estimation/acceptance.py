"""Acceptance of poses, and advice to technicians about rejected ones."""

import math

import numpy as np

from pointit.services.localizer.estimation.angular_residuals import Rays
from pointit.services.localizer.estimation.solution import Refusal, Solution, SolverSettings

AMBIGUOUS_COST = 2.0
"""Two refined minima whose costs differ by less (a factor e² in likelihood) are ambiguous."""

FARTHEST_TARGET_M = 1000.0
"""Largest distance of a target: pointing at farther ones does not determine a position."""

SAME_VIEW_RAD = math.radians(2.0)
"""Rays within this have one direction."""

NOWHERE = "these rays meet nowhere in the world; point at each target, arm straight"
ONE_VIEW = (
    "the arm was held in one direction while there were several targets; "
    "point at each target, arm straight, until it changes"
)

LEVEL_M = 0.1
"""Targets within this of the eye height are seen level."""


def check_solution(
    solution: Solution, place_m: tuple[float, float], rays: Rays, trust: SolverSettings, limit_rad: float
) -> Solution | Refusal:
    """Return `solution`, or the refusal if it is not good enough."""
    residual_rad = solution.residual_rad
    away_m = float(np.median(np.abs(rays.targets - complex(*place_m))))
    is_finite = math.isfinite(away_m + residual_rad) and bool(np.isfinite(solution.covariance).all())
    if away_m > FARTHEST_TARGET_M or not is_finite:
        return Refusal(ONE_VIEW if _is_one_view(rays) else NOWHERE)
    if residual_rad > limit_rad:
        return Refusal(_missed(residual_rad, rays, limit_rad), residual_rad)
    if abs(solution.bias_rad - trust.bias_rad) > trust.bias_sigma_limit * trust.bias_sigma_rad:
        return Refusal(
            f"the rays would lie {math.degrees(solution.bias_rad):+.0f}° too high all the time, which is not "
            "pointing; point at each target, arm straight",
            residual_rad,
        )
    position_m, yaw_rad = solution.position_sigma_m, solution.yaw_sigma_rad
    if position_m > trust.max_position_sigma_m or yaw_rad > trust.max_yaw_sigma_rad:
        return Refusal(_unsure(solution, rays, trust), residual_rad)
    return solution


def untimely(solution: Solution, trust: SolverSettings) -> str:
    """Return advice about a pose that is uncertain only because of the tracker's latency."""
    return (
        f"{_stated(solution, trust)}: the latency of what tracks the target is uncertain "
        f"by {trust.latency_sigma_s:.2f} s; "
        "have the tracker state its `latency_sigma_s`, or the target move slower"
    )


def _missed(residual_rad: float, rays: Rays, limit_rad: float) -> str:
    """Return a message about rays that miss the targets."""
    if _is_one_view(rays):
        return ONE_VIEW
    return (
        f"the rays miss the targets by {math.degrees(residual_rad):.1f}° and at most "
        f"{math.degrees(limit_rad):.1f}° is accepted; point at each target, arm straight"
    )


def _unsure(solution: Solution, rays: Rays, trust: SolverSettings) -> str:
    """Return a message about an uncertain pose and how to make it more certain."""
    stated = _stated(solution, trust)
    if _is_one_view(rays):
        return f"{stated}: the targets lie in one direction; add one far to the side"
    if float(np.max(np.abs(rays.heights))) < LEVEL_M:
        return f"{stated}: all targets are at the height of the eyes; add one below the waist"
    if solution.alternative > 1.0 / (1.0 + math.exp(AMBIGUOUS_COST)):
        return f"{stated}: two places fit the pointing equally well; add a target in another direction"
    return f"{stated}; point longer or at one more target, below the waist or far to the side"


def _stated(solution: Solution, trust: SolverSettings) -> str:
    return (
        f"the pose is uncertain by {min(solution.position_sigma_m, 99.0):.2f} m and "
        f"{min(math.degrees(solution.yaw_sigma_rad), 180.0):.1f}° and at most "
        f"{trust.max_position_sigma_m:.2f} m, {math.degrees(trust.max_yaw_sigma_rad):.1f}° are accepted"
    )


def _is_one_view(rays: Rays) -> bool:
    """Return True if all rays have one direction."""
    turned = np.angle(rays.inverse_azimuth * np.conj(rays.inverse_azimuth[0]))
    spread = float(np.ptp(turned)) * float(np.min(rays.elevation_phasor.real))
    return spread < SAME_VIEW_RAD and float(np.ptp(rays.elevations_rad)) < SAME_VIEW_RAD
