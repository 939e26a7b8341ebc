"""Comparison of solvers on recorded people: pose errors, stated sigma, processor time."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.estimation.mounting import mounting_fault
from pointit.services.localizer.estimation.pointings import blocks
from pointit.services.localizer.moving_target import MIN_SPAN_S
from pointit.services.localizer.verification import followed, held
from pointit_lab.evaluation.localization.baselines import BaselineEstimate, mean_angle_4dof, mean_angle_z0
from pointit_lab.evaluation.localization.cramer_rao import median_bounds_m
from pointit_lab.evaluation.localization.scoring import Key, Outcome, rows_of, until_taken_rows
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from pointit_lab.evaluation.recordings.parallel import map_in_order
from pointit_lab.evaluation.recordings.row import Row, arranged

Solver = Callable[[Pointings], Solution | Refusal | BaselineEstimate]

OURS = "pointit"
STATED = SolverSettings().unlimited()
"""The localizer's settings, but poses of any stated sigma are accepted: errors of certain poses alone would
be too optimistic."""

ANY = STATED.any_fit()
"""Accepts the best fit, as the baselines do."""

LIMITS = SolverSettings()
"""The localizer's own priors and limits, as configured by default."""

CHUNK = 12
"""Trials in one piece of work, solved by all solvers in turn, so that disturbances affect all equally."""

FARTHEST_M = 1e6
"""Limit to which the errors of a diverged solver are clipped, for sums and JSON."""

BASELINE_TRIALS = 400
"""Maximum of trials of a set and condition for the slow baselines; of more, every second, third, …."""


def ours(pointings: Pointings) -> Solution | Refusal:
    """Return the result of the localizer's solver."""
    return solve(pointings, STATED)


SOLVERS: dict[str, Solver] = {OURS: ours, "mean-angle-4dof": mean_angle_4dof, "mean-angle-z0": mean_angle_z0}
"""Solvers by name."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """A trial, and its solvers."""

    trial: LocalizationTrial
    bound_m: float = math.nan
    solvers: tuple[str, ...]


def localization_rows(
    trials: Sequence[LocalizationTrial], *, baselines: bool, jobs: int, tick: Callable[[int, int], None]
) -> list[Row]:
    """Return the results of each solver on `trials`.

    Args:
        trials: as read by `pointit_lab.evaluation.datasets`.
        baselines: also run the baselines.
        jobs: number of processes.
        tick: called with the number of finished trials and of all.

    Raises:
        PointItError: If a process ended unexpectedly.
    """
    tasks = list(_tasks(trials, baselines=baselines))
    solved = map_in_order(solve_task, tasks, jobs=jobs, chunk=CHUNK, tick=tick)
    outcomes = list(chain.from_iterable(solved))
    return arranged([*rows_of(outcomes), *until_taken_rows(outcomes)])


def solve_task(task: Task) -> list[Outcome]:
    """Return the outcome of each solver on a trial. Runs in other processes."""
    return [outcome(task.trial, task.bound_m, name, SOLVERS[name]) for name in task.solvers]


def _tasks(trials: Sequence[LocalizationTrial], *, baselines: bool) -> Iterator[Task]:
    sizes = Counter((trial.set, trial.condition) for trial in trials)
    seen: Counter[tuple[str, str]] = Counter()
    for trial, bound_m in zip(trials, _bounds(trials), strict=True):
        group = (trial.set, trial.condition)
        # baselines are slow: they run on some trials, evenly taken
        stride = math.ceil(sizes[group] / BASELINE_TRIALS)
        with_others = baselines and seen[group] % stride == 0
        seen[group] += 1
        solvers = tuple(SOLVERS) if with_others else (OURS,)
        yield Task(trial=trial, bound_m=bound_m, solvers=solvers)


def _bounds(trials: Sequence[LocalizationTrial]) -> list[float]:
    """Return the bound of each trial, from the errors of its person in their other trials, too."""
    sets: dict[str, list[int]] = {}
    for number, trial in enumerate(trials):
        sets.setdefault(trial.set, []).append(number)
    all_bounds_m = [math.nan] * len(trials)
    for numbers in sets.values():
        bounds_m = median_bounds_m([trials[number] for number in numbers])
        for number, bound_m in zip(numbers, bounds_m, strict=True):
            all_bounds_m[number] = bound_m
    return all_bounds_m


def outcome(trial: LocalizationTrial, bound_m: float, name: str, solver: Solver) -> Outcome:
    """Return the outcome of `solver`, called `name`, on `trial`."""
    began_ns = time.process_time_ns()
    estimate = solver(trial.pointings)
    solve_ms = (time.process_time_ns() - began_ns) / 1e6
    key = Key.of(trial)

    # what the running localizer takes of it, with its own rules for lamps and following
    taken_m = None
    if solver is ours:
        verdict = judged(trial.pointings)
        taken_m = off_m(verdict, trial) if isinstance(verdict, Solution) else math.inf

    # a refusal counts with the error of the best fit
    if isinstance(estimate, Refusal):
        best = solve(trial.pointings, ANY)
        return Outcome(
            key=key,
            solver=name,
            solve_ms=solve_ms,
            refused=estimate.reason,
            taken_m=taken_m,
            recording=trial.recording,
            start_s=trial.start_s,
            position_m=off_m(best, trial) if isinstance(best, Solution) else math.nan,
            bound_m=bound_m,
        )

    # baselines state no sigma
    yaw_deg = math.nan
    if trial.yaw_rad is not None and math.isfinite(estimate.yaw_rad):
        yaw_deg = math.degrees(math.remainder(estimate.yaw_rad - trial.yaw_rad, math.tau))
    sigma_m = math.nan
    yaw_sigma_deg = math.nan
    is_sure = True
    if isinstance(estimate, Solution):
        is_sure = LIMITS.accepts(estimate)
        sigma_m = estimate.position_sigma_m
        yaw_sigma_deg = math.degrees(estimate.yaw_sigma_rad)
    return Outcome(
        key=key,
        solver=name,
        solve_ms=solve_ms,
        position_m=off_m(estimate, trial),
        yaw_deg=yaw_deg,
        position_sigma_m=sigma_m,
        yaw_sigma_deg=yaw_sigma_deg,
        is_sure=is_sure,
        taken_m=taken_m,
        recording=trial.recording,
        start_s=trial.start_s,
        bound_m=bound_m,
    )


def off_m(solution: Solution | BaselineEstimate, trial: LocalizationTrial) -> float:
    """Return the horizontal error of `solution`, at most `FARTHEST_M`."""
    error_m = math.hypot(solution.x_m - trial.x_m, solution.y_m - trial.y_m)
    return min(error_m, FARTHEST_M) if math.isfinite(error_m) else FARTHEST_M


def judged(pointings: Pointings, settings: SolverSettings = LIMITS) -> Solution | Refusal:
    """Return the pose that the localizer takes from `pointings`, or its refusal."""
    if not len(pointings):
        return solve(pointings, settings)
    if blocks(pointings).is_still:
        return held(pointings, settings)
    if pointings.span_s < MIN_SPAN_S:
        return Refusal(f"followed for less than {MIN_SPAN_S:g} s")
    result = followed(pointings, settings)
    fault = mounting_fault(pointings, result, settings, 0.0)
    return Refusal(fault, result.residual_rad) if fault else result
