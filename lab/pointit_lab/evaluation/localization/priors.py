"""Poses whose prior is mean and standard deviation of the biases of other people, for a person never seen."""

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from pointit.services.localizer.estimation.estimator import Solution, SolverSettings, solve
from pointit_lab.evaluation.datasets.synth_two_led import NAME as SIMULATED
from pointit_lab.evaluation.localization.localization import STATED, Solver, outcome
from pointit_lab.evaluation.localization.scoring import Outcome, rows_of
from pointit_lab.evaluation.localization.trial import LocalizationTrial
from pointit_lab.evaluation.recordings.row import Row

PEOPLE = "people"

SHORT_S = 5.0
"""Longest window whose pose knowing the person improves."""

MIN_PEOPLE = 3
"""Smallest number of other people for a prior."""

PEOPLE_REMARK = (
    "`people`: the prior of the elevation bias is that of all other people, of the {count} here {mean:+.1f}° "
    "± {sigma:.1f}°; the localizer's is 0° ± {ours:.0f}°."
)

Person = tuple[str, str]
"""Set and subject."""


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Rows of priors, and remarks on them."""

    rows: list[Row]
    remarks: list[str]


def prior_rows(
    trials: Sequence[LocalizationTrial], *, baselines: bool, tick: Callable[[int], None]
) -> Priors:
    """Return, with `baselines`, the rows with the prior of other people."""
    rows, remarks = list[Row](), list[str]()
    biases = person_biases(trials) if baselines else {}
    if len(biases) > MIN_PEOPLE:
        rows += people_rows(trials, biases, tick)
        mean, sigma = people_prior(list(biases.values()))
        remarks.append(
            PEOPLE_REMARK.format(
                count=len(biases),
                mean=math.degrees(mean),
                sigma=math.degrees(sigma),
                ours=math.degrees(STATED.bias_sigma_rad),
            )
        )
    return Priors(rows=rows, remarks=remarks)


def people_rows(
    trials: Sequence[LocalizationTrial],
    biases: Mapping[Person, float],
    tick: Callable[[int], None] = lambda _: None,
) -> list[Row]:
    """Return the rows of poses whose prior is that of the `biases` of all other people."""
    outcomes: list[Outcome] = []
    for trial in trials:
        others = [bias for person, bias in biases.items() if person != (trial.set, trial.subject)]
        is_person = (trial.set, trial.subject) in biases
        if is_person and len(others) >= MIN_PEOPLE and _duration_s(trial) <= SHORT_S:
            outcomes.append(outcome(trial, float("nan"), PEOPLE, _expecting(*people_prior(others))))
            tick(len(outcomes))
    return rows_of(outcomes)


def person_biases(trials: Sequence[LocalizationTrial]) -> dict[Person, float]:
    """Return the median elevation bias (rad) that is found of each person, in their longest trials."""
    longest: dict[Person, list[LocalizationTrial]] = {}
    for trial in trials:
        if trial.set == SIMULATED:
            continue
        best = longest.setdefault((trial.set, trial.subject), [trial])
        if trial.pointings.span_s > 1.05 * best[0].pointings.span_s:
            best.clear()
        if not best or trial.pointings.span_s > 0.95 * best[0].pointings.span_s:
            best.append(trial)
    found = {person: [solve(each.pointings, STATED) for each in best] for person, best in longest.items()}
    return {
        person: statistics.median(each.bias_rad for each in results if isinstance(each, Solution))
        for person, results in found.items()
        if any(isinstance(each, Solution) for each in results)
    }


def people_prior(biases: Sequence[float]) -> tuple[float, float]:
    """Return mean and standard deviation of at least two people's biases."""
    return statistics.fmean(biases), statistics.stdev(biases)


def _expecting(mean: float, sigma: float) -> Solver:
    limit = STATED.bias_sigma_limit * STATED.bias_sigma_rad / sigma  # the same angle
    settings: SolverSettings = replace(STATED, bias_rad=mean, bias_sigma_rad=sigma, bias_sigma_limit=limit)
    return lambda pointings: solve(pointings, settings)


def _duration_s(trial: LocalizationTrial) -> float:
    """Return the length of a window by its condition, as samples may be missing at its end; 0 for lamps."""
    return float(trial.condition.removesuffix(" s")) if trial.recording else 0.0
