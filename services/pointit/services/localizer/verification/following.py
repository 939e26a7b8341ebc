"""Check that rays follow a moving target, which an arm that came late or does not point does not.

Rays of a few seconds leave little redundancy, so that a wrong pose can look certain. Recorded people who
follow miss by 0.4 to 1.9 degrees rms (the middle 80 %), others by up to 4, and the target explains nine
tenths of their movement or more. An arm that comes up within 2 or 3 s misses by 2.3 degrees or more, within
5 s mostly by 3.5 or more, and of a hanging or typing arm the target explains little. So the shorter the time,
the closer the rays must follow. `floor_m` is the height of the floor in {W}.
"""

import numpy as np

from pointit.services.localizer.estimation.estimator import solve
from pointit.services.localizer.estimation.sample_blocks import Pointings
from pointit.services.localizer.estimation.solution import Refusal, Solution, SolverSettings
from pointit.services.localizer.verification.holds import without_spikes

CLOSE = 1.1
"""Largest rms of few rays, in sigmas of a ray."""

CLOSE_PER_S = 0.3
"""The same of many, per second of following."""

NOISY = 2.2
"""The same if the arm misses by as much in the newest half, so that it did not come late."""

NOISY_S = 2.9
"""Least time of following that tells: an arm is up within the first half of it."""

AS_MUCH = 0.5
"""Least ratio of the rms of the newest half, in its own pose, to that of all."""

EXPLAINED = 0.85
"""Least share of the rays' variance that the target explains."""

AGREEING = 2.37
"""Median of chi-square of x, y and yaw. Differences of a person who follows share rays and constant errors:
on recordings they stay below 1.4. An arm that came late makes 10 to 20.
"""

CHANGED = "the newest rays contradict the ones before; keep following the robot with the arm straight"
UNSETTLED = "the rays do not follow the robot closely yet; keep following it with the arm straight"


def followed(
    pointings: Pointings, settings: SolverSettings, *, floor_m: float = 0.0, start: Solution | None = None
) -> Solution | Refusal:
    """Return the pose of rays at one moving target, or the refusal if they may not follow it."""
    pointings = without_spikes(pointings)
    result = solve(pointings, settings, floor_m=floor_m, start=start)
    if isinstance(result, Refusal):
        return result
    half = solve(newest_half(pointings), settings.unlimited(), floor_m=floor_m, start=result)
    is_noisy = pointings.span_s >= NOISY_S and (half.residual_rad or 0.0) >= AS_MUCH * result.residual_rad
    if not is_settled(pointings, result.residual_rad, settings, NOISY if is_noisy else CLOSE):
        return Refusal(UNSETTLED, result.residual_rad)
    is_same = isinstance(half, Refusal) or half.differs(result) <= AGREEING
    return result if is_same else Refusal(CHANGED, result.residual_rad)


def is_settled(
    pointings: Pointings, residual_rad: float, settings: SolverSettings, min_sigmas: float = CLOSE
) -> bool:
    """Return True if rays that miss by `residual_rad` rms follow the target, and move because it does.

    `min_sigmas`: rms that is close enough, however few they are, in sigmas of a ray.
    """
    level = np.hypot(pointings.directions[:, 0], pointings.directions[:, 1])
    headings = pointings.directions[:, 0] + 1j * pointings.directions[:, 1]
    azimuths = np.angle(headings * np.conj(headings.mean()))
    elevations = np.arctan2(pointings.directions[:, 2], level)
    variance = float(np.var(azimuths * level) + np.var(elevations))
    limit_rad = settings.ray_sigma_rad * max(min_sigmas, CLOSE_PER_S * pointings.span_s)
    return residual_rad**2 <= min(limit_rad**2, (1.0 - EXPLAINED) * variance)


def has_settled(
    pointings: Pointings, missed: Refusal, settings: SolverSettings, *, floor_m: float = 0.0
) -> bool:
    """Return True if the newest half of the rays follows the target closely and all of them do not.

    Then the arm came late: the older half is of no use.
    """
    pointings = without_spikes(pointings)
    if missed.residual_rad is None or is_settled(pointings, missed.residual_rad, settings):
        return False
    half = newest_half(pointings)
    solution = solve(half, settings.unlimited(), floor_m=floor_m)
    return isinstance(solution, Solution) and is_settled(half, solution.residual_rad, settings)


def newest_half(pointings: Pointings) -> Pointings:
    """Return the samples of the second half of the time."""
    first_s, last_s = float(pointings.stamps_s[0]), float(pointings.stamps_s[-1])
    return pointings.only(pointings.stamps_s >= 0.5 * (first_s + last_s))
