"""Checks of rays: at lamps or at a moving target, an arm that pointed elsewhere must not give a pose.

Recorded people miss the targets by 1 to 5 degrees rms from the pose that fits best; if one of four to six
pointings was at another lamp it is 6 to 20 degrees. Then, if all the others agree without it, they count
alone. Rays come one hold after the other; `floor_m` is the height of the floor in {W}.

Rays of a few seconds leave little redundancy, so that a wrong pose can look certain. Recorded people who
follow miss by 0.4 to 1.9 degrees rms (the middle 80 %), others by up to 4, and the target explains nine
tenths of their movement or more. An arm that comes up within 2 or 3 s misses by 2.3 degrees or more, within
5 s mostly by 3.5 or more, and of a hanging or typing arm the target explains little. So the shorter the time,
the closer the rays must follow. `floor_m` is the height of the floor in {W}.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from pointit.services.localizer.estimation.estimator import solve
from pointit.services.localizer.estimation.levenberg_marquardt import Rays, angular_errors
from pointit.services.localizer.estimation.mounting import mounting_fault
from pointit.services.localizer.estimation.pointings import Pointings, lamp_numbers
from pointit.services.localizer.estimation.solution import Refusal, Solution, SolverSettings

AGREEING = 1.2
"""Largest rms of holds that agree, in sigmas of one pointing sideways."""

MIN_OTHER_LAMPS = 4
"""Lamps that must agree without another one for it to be left out: three determine a pose almost exactly."""

MAX_LAMPS = 12
"""Number of lamps, the first ones, of which each pair is tried as swapped."""

IMPROVED = 0.5
"""Ratio of the rms of the others to that of all from which one lamp is to blame, or two are."""

MISSED_RAD = math.radians(15.0)
"""Least angle by which that lamp is missed."""

CONTRADICT = "the pointings contradict one another; point at each lamp that is lit, arm straight"

SWAPPED = (
    "the pointings contradict one another, but agree if the lamps {} and {} are swapped; check their places "
    "in the map"
)

NEIGHBOURS = 3
"""Number of samples before and after, with whose median a ray is compared."""

SPIKE_RAD = math.radians(12.0)
"""Least angle between a spike and the median. An arm that reaches, by 100 degrees a second, is 4 degrees off
within 40 ms (pointing.md §7)."""

CLOSE = 1.1
"""Largest rms of few rays, in sigmas of a ray."""

CLOSE_PER_S = 0.3
"""The same of many, per second of following."""

NOISY = 2.2
"""The same if the arm misses by as much in the newest half, so that it did not come late."""

NOISY_S = 2.9
"""Shortest time of following that can show it: an arm is up within the first half of it."""

AS_MUCH = 0.5
"""Least ratio of the rms of the newest half, in its own pose, to that of all."""

EXPLAINED = 0.85
"""Least share of the rays' variance that the target explains."""

FOLLOWING_AGREEING = 2.37
"""Median of chi-square of x, y and yaw. Differences of a person who follows share rays and constant errors:
on recordings they stay below 1.4. An arm that came late makes 10 to 20.
"""

CHANGED = "the newest rays contradict the ones before; keep following the robot with the arm straight"
UNSETTLED = "the rays do not follow the robot closely yet; keep following it with the arm straight"


def held(
    pointings: Pointings,
    settings: SolverSettings,
    *,
    floor_m: float = 0.0,
    start: Solution | None = None,
    lamps: Sequence[str] = (),
) -> Solution | Refusal:
    """Return the pose of holds at targets at rest, without a lamp that is missed, or the refusal.

    `lamps`: their ids, in the order of first holds. The refusal names those that are swapped in the map.
    """
    steady = without_spikes(pointings)
    result = solve(steady, settings, floor_m=floor_m, start=start)

    # The mounting first: a sensor across the arm makes the pointings contradict one another, too
    numbers = lamp_numbers(steady)
    lamp_count = len(np.unique(numbers))
    fault = mounting_fault(steady, result, settings, floor_m, holds=lamp_count)
    if fault:
        return Refusal(fault, result.residual_rad)
    if result.residual_rad is None or result.residual_rad <= AGREEING * settings.act_sigma_rad:
        return result

    # The pointings contradict one another: look for a lamp that is missed, or two that are swapped
    outliers = outlier_lamps(pointings, settings, floor_m=floor_m)
    if len(outliers) == 2:
        names = [f"number {number + 1}" for number in outliers]
        if lamps:
            names = [lamps[number] for number in outliers]
        return Refusal(SWAPPED.format(*names), result.residual_rad)
    if outliers:
        others = steady.only(numbers != outliers[0])
        return solve(others, settings, floor_m=floor_m, start=start)
    if isinstance(result, Refusal):
        return result
    return Refusal(CONTRADICT, result.residual_rad)


def outlier_lamps(pointings: Pointings, settings: SolverSettings, *, floor_m: float = 0.0) -> tuple[int, ...]:
    """Return the lamp that is missed while the others agree, or the two with which all agree if swapped.

    They are numbered by their first holds. Empty if neither explains the rays by far.
    """
    # All lamps, however far they are missed
    steady = without_spikes(pointings)
    numbers = lamp_numbers(steady)
    count = int(numbers.max(initial=-1)) + 1
    if count <= MIN_OTHER_LAMPS:
        return ()
    whole = solve(steady, settings.any_fit(), floor_m=floor_m)
    agreeing_rad = AGREEING * settings.act_sigma_rad
    if not isinstance(whole, Solution) or whole.residual_rad <= agreeing_rad:
        return ()

    unlimited = replace(settings.unlimited(), max_act_residual_rad=math.inf)
    limit_rad = min(agreeing_rad, IMPROVED * whole.residual_rad)
    _, first_samples = np.unique(numbers, return_index=True)
    places_m = steady.targets_m[first_samples]

    # One lamp left out, before two swapped: a mistake of the person is likelier than one of the map
    for size, lamp_count in ((1, count), (2, min(count, MAX_LAMPS))):
        best: tuple[int, ...] = ()
        best_fit: Solution | None = None
        for outliers in combinations(range(lamp_count), size):
            if size == 1:
                explained = steady.only(numbers != outliers[0])
            else:
                order = np.arange(count)
                order[list(outliers)] = outliers[::-1]
                explained = replace(steady, targets_m=places_m[order][numbers])
            fit = solve(explained, unlimited, floor_m=floor_m)
            if not isinstance(fit, Solution):
                continue
            if best_fit is None or fit.residual_rad < best_fit.residual_rad:
                best = outliers
                best_fit = fit
        if best_fit is None or not best_fit.residual_rad <= limit_rad:
            continue

        # Only if the pose of the others shows that they are missed by far
        misses_rad = [_miss_rad(steady.only(numbers == number), best_fit, floor_m) for number in best]
        if min(misses_rad) >= MISSED_RAD:
            return best
    return ()


def _miss_rad(hold: Pointings, solution: Solution, floor_m: float) -> float:
    """Return the median angle between the rays of `hold` and its target, as seen from `solution`."""
    place_m = np.array([solution.x_m, solution.y_m, floor_m])
    rays = Rays.of(hold.origins_m, hold.directions, hold.targets_m - place_m)
    pose = np.array([[0.0, 0.0, solution.yaw_rad, solution.bias_rad, solution.z_m]])
    left, above = angular_errors(rays, pose)
    angles_rad = 2.0 * np.arctan(0.5 * np.hypot(left, above))
    return float(np.median(angles_rad))


def without_spikes(pointings: Pointings) -> Pointings:
    """Return the samples whose rays are near the median of their neighbours."""
    width = 2 * NEIGHBOURS + 1
    if len(pointings) < width:
        return pointings
    rays = np.pad(pointings.directions, ((NEIGHBOURS, NEIGHBOURS), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(rays, width, axis=0)
    medians = np.median(windows, axis=2)
    lengths = np.maximum(np.linalg.norm(medians, axis=1), 1e-9)
    cosines = np.einsum("ij,ij->i", pointings.directions, medians) / lengths
    is_near = cosines >= math.cos(SPIKE_RAD)
    return pointings if is_near.all() else pointings.only(is_near)


def followed(
    pointings: Pointings, settings: SolverSettings, *, floor_m: float = 0.0, start: Solution | None = None
) -> Solution | Refusal:
    """Return the pose of rays at one moving target, or the refusal if they may not follow it."""
    pointings = without_spikes(pointings)
    result = solve(pointings, settings, floor_m=floor_m, start=start)
    if isinstance(result, Refusal):
        return result

    # A person who misses by as much in the newest half points badly, one who misses by less came late
    half = solve(newest_half(pointings), settings.unlimited(), floor_m=floor_m, start=result)
    half_residual_rad = half.residual_rad or 0.0
    is_noisy = pointings.span_s >= NOISY_S and half_residual_rad >= AS_MUCH * result.residual_rad
    if not is_settled(pointings, result.residual_rad, settings, NOISY if is_noisy else CLOSE):
        return Refusal(UNSETTLED, result.residual_rad)
    if isinstance(half, Refusal) or half.differs(result) <= FOLLOWING_AGREEING:
        return result
    return Refusal(CHANGED, result.residual_rad)


def is_settled(
    pointings: Pointings, residual_rad: float, settings: SolverSettings, min_sigmas: float = CLOSE
) -> bool:
    """Return True if rays that miss by `residual_rad` rms follow the target, and move because it does.

    `min_sigmas`: rms that is close enough, however few they are, in sigmas of a ray.
    """
    x, y, z = pointings.directions.T
    level = np.hypot(x, y)
    headings = x + 1j * y
    azimuths = np.angle(headings * np.conj(headings.mean()))
    elevations = np.arctan2(z, level)
    variance = float(np.var(azimuths * level) + np.var(elevations))
    unexplained = (1.0 - EXPLAINED) * variance
    limit_rad = settings.ray_sigma_rad * max(min_sigmas, CLOSE_PER_S * pointings.span_s)
    return residual_rad**2 <= min(limit_rad**2, unexplained)


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
    first_s = float(pointings.stamps_s[0])
    last_s = float(pointings.stamps_s[-1])
    return pointings.only(pointings.stamps_s >= 0.5 * (first_s + last_s))
