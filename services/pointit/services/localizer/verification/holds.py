"""Check that rays at lamps were pointed at all of them: one at another lamp must not give a pose.

Recorded people miss the targets by 1 to 5 degrees rms from the pose that fits best; if one of four to six
pointings was at another lamp it is 6 to 20 degrees. Then, if all the others agree without it, they count
alone. Rays come one hold after the other; `floor_m` is the height of the floor in {W}.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pointit.services.localizer.estimation.angular_residuals import Rays, angular_errors
from pointit.services.localizer.estimation.mounting import held_mounting_fault
from pointit.services.localizer.estimation.sample_blocks import GAP_S, JUMP_M, Pointings
from pointit.services.localizer.estimation.solution import Refusal, Solution, SolverSettings
from pointit.services.localizer.memory.recall import solve

AGREEING = 1.2
"""Largest rms of holds that agree, in sigmas of one pointing sideways."""

LEAST_OTHERS = 4
"""Holds that must agree without another one for it to be left out: three determine a pose almost exactly."""

IMPROVED = 0.5
"""Ratio of the rms of the others to that of all from which one hold is to blame."""

MISSED_RAD = math.radians(15.0)
"""Least angle by which that hold misses its target."""

CONTRADICT = "the pointings contradict one another; point at each lamp that is lit, arm straight"

NEIGHBOURS = 3
"""Number of samples before and after, with whose median a ray is compared."""

SPIKE_RAD = math.radians(12.0)
"""Least angle between a spike and the median. An arm that reaches, by 100 degrees a second, is 4 degrees off
within 40 ms (pointing.md §7)."""


def held(
    pointings: Pointings, trust: SolverSettings, *, floor_m: float = 0.0, start: Solution | None = None
) -> Solution | Refusal:
    """Return the pose of holds at targets at rest, without one that misses, or the refusal."""
    steady = without_spikes(pointings)
    result = solve(steady, trust, floor_m=floor_m, start=start)
    holds = len(np.unique(hold_numbers(steady)))
    wrong = held_mounting_fault(steady, result, trust, floor_m, holds=holds)
    if wrong:
        return Refusal(wrong, result.residual_rad)
    if result.residual_rad is None or result.residual_rad <= AGREEING * trust.act_sigma_rad:
        return result
    odd = odd_hold(pointings, trust, floor_m=floor_m)
    if odd is None:
        return result if isinstance(result, Refusal) else Refusal(CONTRADICT, result.residual_rad)
    return solve(steady.only(hold_numbers(steady) != odd), trust, floor_m=floor_m, start=start)


def odd_hold(pointings: Pointings, trust: SolverSettings, *, floor_m: float = 0.0) -> int | None:
    """Return the number of the hold that misses while all others agree, or None."""
    steady = without_spikes(pointings)
    numbers = hold_numbers(steady)
    count = int(numbers[-1]) + 1 if len(numbers) else 0
    unlimited = replace(trust.unlimited(), max_act_residual_rad=math.inf)
    whole = solve(steady, unlimited, floor_m=floor_m) if count > LEAST_OTHERS else None
    if not isinstance(whole, Solution) or whole.residual_rad <= AGREEING * trust.act_sigma_rad:
        return None
    fits = [solve(steady.only(numbers != number), unlimited, floor_m=floor_m) for number in range(count)]
    rms = [fit.residual_rad if isinstance(fit, Solution) else math.inf for fit in fits]
    best = int(np.argmin(rms))
    found = fits[best]
    limit_rad = min(AGREEING * trust.act_sigma_rad, IMPROVED * whole.residual_rad)
    if not isinstance(found, Solution) or rms[best] > limit_rad:
        return None
    missed_rad = _miss_rad(steady.only(numbers == best), found, floor_m)
    return best if missed_rad >= MISSED_RAD else None


def hold_numbers(pointings: Pointings) -> NDArray[np.intp]:
    """Return the number (n) of the hold of each sample, from 0."""
    if not len(pointings):
        return np.zeros(0, dtype=np.intp)
    moves = np.abs(np.diff(pointings.targets_m, axis=0, prepend=pointings.targets_m[:1])).max(axis=1)
    begins = (np.diff(pointings.stamps_s, prepend=pointings.stamps_s[0]) > GAP_S) | (moves > JUMP_M)
    return np.asarray(np.cumsum(begins), dtype=np.intp)


def _miss_rad(hold: Pointings, pose: Solution, floor_m: float) -> float:
    """Return the median angle between the rays of `hold` and its target, as seen from `pose`."""
    place_m = np.array([pose.x_m, pose.y_m, floor_m])
    rays = Rays.of(hold.origins_m, hold.directions, hold.targets_m - place_m)
    turned = np.array([[0.0, 0.0, pose.yaw_rad, pose.bias_rad, pose.z_m]])
    left, above = angular_errors(rays, turned)
    return float(np.median(2.0 * np.arctan(0.5 * np.hypot(left, above))))


def without_spikes(pointings: Pointings) -> Pointings:
    """Return the samples whose rays are near the median of their neighbours."""
    width = 2 * NEIGHBOURS + 1
    if len(pointings) < width:
        return pointings
    rays = np.pad(pointings.directions, ((NEIGHBOURS, NEIGHBOURS), (0, 0)), mode="reflect")
    middles = np.median(np.lib.stride_tricks.sliding_window_view(rays, width, axis=0), axis=2)
    lengths = np.maximum(np.linalg.norm(middles, axis=1), 1e-9)
    along = np.einsum("ij,ij->i", pointings.directions, middles) / lengths
    near = along >= math.cos(SPIKE_RAD)
    return pointings if near.all() else pointings.only(near)
