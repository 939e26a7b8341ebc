"""Comparison of solvers on recorded people: pose errors, stated sigma, processor time."""

import math
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
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
    rows = [*rows_of(outcomes), *until_taken_rows(outcomes)]
    return arranged(rows)


def solve_task(task: Task) -> list[Outcome]:
    """Return the outcome of each solver on a trial. Runs in other processes."""
    outcomes: list[Outcome] = []
    for name in task.solvers:
        outcomes.append(outcome(task.trial, task.bound_m, name, SOLVERS[name]))
    return outcomes


def _tasks(trials: Sequence[LocalizationTrial], *, baselines: bool) -> Iterator[Task]:
    sizes = Counter((trial.set, trial.condition) for trial in trials)
    seen: Counter[tuple[str, str]] = Counter()
    for trial, bound_m in zip(trials, _bounds(trials), strict=True):
        group = (trial.set, trial.condition)
        # baselines are slow: they run on some trials, evenly taken
        stride = math.ceil(sizes[group] / BASELINE_TRIALS)
        is_sampled = seen[group] % stride == 0
        seen[group] += 1
        solvers = (OURS,)
        if baselines and is_sampled:
            solvers = tuple(SOLVERS)
        yield Task(trial=trial, bound_m=bound_m, solvers=solvers)


def _bounds(trials: Sequence[LocalizationTrial]) -> list[float]:
    """Return the bound of each trial, from the errors of its person in their other trials, too."""
    sets = defaultdict[str, list[int]](list)
    for number, trial in enumerate(trials):
        sets[trial.set].append(number)
    all_bounds_m = [math.nan] * len(trials)
    for numbers in sets.values():
        own_trials = [trials[number] for number in numbers]
        bounds_m = median_bounds_m(own_trials)
        for number, bound_m in zip(numbers, bounds_m, strict=True):
            all_bounds_m[number] = bound_m
    return all_bounds_m


def outcome(trial: LocalizationTrial, bound_m: float, name: str, solver: Solver) -> Outcome:
    """Return the outcome of `solver`, called `name`, on `trial`."""
    start_ns = time.process_time_ns()
    estimate = solver(trial.pointings)
    solve_ms = (time.process_time_ns() - start_ns) / 1e6

    # what the running localizer takes of it, with its own rules for lamps and following
    taken_m = None
    if solver is ours:
        taken_m = math.inf
        verdict = judged(trial.pointings)
        if isinstance(verdict, Solution):
            taken_m = off_m(verdict, trial)
    unsolved = Outcome(
        key=Key.of(trial),
        solver=name,
        solve_ms=solve_ms,
        taken_m=taken_m,
        recording=trial.recording,
        start_s=trial.start_s,
        bound_m=bound_m,
    )

    # a refusal counts with the error of the best fit
    if isinstance(estimate, Refusal):
        position_m = math.nan
        best = solve(trial.pointings, ANY)
        if isinstance(best, Solution):
            position_m = off_m(best, trial)
        return replace(unsolved, refused=estimate.reason, position_m=position_m)

    yaw_deg = _yaw_error_deg(estimate, trial)
    solved = replace(unsolved, position_m=off_m(estimate, trial), yaw_deg=yaw_deg)
    if isinstance(estimate, BaselineEstimate):
        return solved  # it states no sigma
    return replace(
        solved,
        position_sigma_m=estimate.position_sigma_m,
        yaw_sigma_deg=math.degrees(estimate.yaw_sigma_rad),
        is_sure=LIMITS.accepts(estimate),
    )


def _yaw_error_deg(estimate: Solution | BaselineEstimate, trial: LocalizationTrial) -> float:
    """Return the signed error, NaN if the truth is unknown or the solver diverged."""
    if trial.yaw_rad is None or not math.isfinite(estimate.yaw_rad):
        return math.nan
    error_rad = math.remainder(estimate.yaw_rad - trial.yaw_rad, math.tau)
    return math.degrees(error_rad)


def off_m(solution: Solution | BaselineEstimate, trial: LocalizationTrial) -> float:
    """Return the horizontal error of `solution`, at most `FARTHEST_M`."""
    error_m = math.hypot(solution.x_m - trial.x_m, solution.y_m - trial.y_m)
    if not math.isfinite(error_m):
        return FARTHEST_M
    return min(error_m, FARTHEST_M)


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
