"""Poses with the memory of the person's other sessions, or with the biases of other people, as the prior.

`memory`: the person was localized once in each of their other recordings, as the localizer remembers it.
`people`: mean and standard deviation of the biases of all other people, for a person never seen.
"""

import math
import statistics
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from pointit.schemas import NS_PER_S, Gaussian
from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.memory import recall
from pointit.services.localizer.memory.person_memory import PersonMemory
from pointit_lab.evaluation.datasets.synth_two_led import NAME as SIMULATED
from pointit_lab.evaluation.localization.localization import OURS, STATED, Solver, ours, outcome
from pointit_lab.evaluation.localization.scoring import Outcome, rows_of
from pointit_lab.evaluation.localization.trial import Trial
from pointit_lab.evaluation.recordings.row import Row

MEMORY = "memory"
PEOPLE = "people"
KNOWN = "known"
"""Mark of the conditions: trials of people with other recordings."""

SHORT_S = 5.0
"""Longest window whose pose knowing the person improves."""
LEARNT_S = 10.0
"""Length of the window from which the other sessions teach, as the localizer's."""
DAY_NS = 86_400 * NS_PER_S
"""Time between two sessions."""

MIN_PEOPLE = 3
"""Smallest number of other people for a prior."""

KNOWN_REMARK = (
    "`memory`: the person was localized once in each of their other recordings, and is remembered; `pointit` "
    "beside it is not told."
)
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


def prior_rows(trials: Sequence[Trial], *, baselines: bool, tick: Callable[[int], None]) -> Priors:
    """Return the rows with the memory of the person and, with `baselines`, with the prior of other people."""
    rows = known_rows(trials, tick)
    remarks = [KNOWN_REMARK] if rows else []
    biases = person_biases(trials) if baselines else {}
    if len(biases) > MIN_PEOPLE:
        rows += people_rows(trials, biases, tick)
        prior = people_prior(list(biases.values()))
        remarks.append(
            PEOPLE_REMARK.format(
                count=len(biases),
                mean=math.degrees(prior.mean),
                sigma=math.degrees(prior.sigma),
                ours=math.degrees(STATED.bias_sigma_rad),
            )
        )
    return Priors(rows=rows, remarks=remarks)


def known_rows(trials: Sequence[Trial], tick: Callable[[int], None] = lambda _: None) -> list[Row]:
    """Return the rows of poses without and with the memory of the person's other recordings.

    Args:
        trials: windows of all lengths.
        tick: called with the number of finished trials.
    """
    people: dict[Person, dict[str, list[Trial]]] = defaultdict(lambda: defaultdict(list))
    for trial in trials:
        if trial.recording:
            people[trial.set, trial.subject][trial.recording].append(trial)
    outcomes: list[Outcome] = []
    for recordings in people.values():
        for name, windows in recordings.items():
            others = [each for other, each in recordings.items() if other != name]
            memory = _taught([trial for each in others for trial in _lessons(each)])
            if not memory.learnt:
                continue
            for trial in windows:
                if _duration_s(trial) <= SHORT_S:
                    known = replace(trial, condition=f"{trial.condition}, {KNOWN}")
                    outcomes.append(outcome(known, float("nan"), OURS, ours))
                    outcomes.append(outcome(known, float("nan"), MEMORY, _remembering(memory)))
                    tick(len(outcomes))
    return rows_of(outcomes)


def people_rows(
    trials: Sequence[Trial], biases: Mapping[Person, float], tick: Callable[[int], None] = lambda _: None
) -> list[Row]:
    """Return the rows of poses whose prior is that of the `biases` of all other people."""
    outcomes: list[Outcome] = []
    for trial in trials:
        others = [bias for person, bias in biases.items() if person != (trial.set, trial.subject)]
        is_person = (trial.set, trial.subject) in biases
        if is_person and len(others) >= MIN_PEOPLE and _duration_s(trial) <= SHORT_S:
            outcomes.append(outcome(trial, float("nan"), PEOPLE, _expecting(people_prior(others))))
            tick(len(outcomes))
    return rows_of(outcomes)


def person_biases(trials: Sequence[Trial]) -> dict[Person, float]:
    """Return the median elevation bias (rad) that is found of each person, in their longest trials."""
    longest: dict[Person, list[Trial]] = {}
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


def people_prior(biases: Sequence[float]) -> Gaussian:
    """Return mean and standard deviation of at least two people's biases."""
    return Gaussian(mean=statistics.fmean(biases), sigma=statistics.stdev(biases))


def _lessons(recording: Sequence[Trial]) -> Iterator[Trial]:
    """Yield the middle one of the longest windows up to `LEARNT_S`."""
    lengths = [_duration_s(trial) for trial in recording if _duration_s(trial) <= LEARNT_S]
    longest = [trial for trial in recording if lengths and _duration_s(trial) == max(lengths)]
    yield from longest[len(longest) // 2 :][:1]


def _taught(lessons: Sequence[Trial]) -> PersonMemory:
    memory = PersonMemory()
    memory.mounting = KNOWN
    for day, lesson in enumerate(lessons):
        memory.begin(day * DAY_NS)
        found = recall.solve(lesson.pointings, memory.recall(STATED))
        if isinstance(found, Solution):
            memory.learn(found, STATED, day * DAY_NS)
    memory.begin(len(lessons) * DAY_NS)
    return memory


def _remembering(memory: PersonMemory) -> Solver:
    def solver(pointings: Pointings) -> Solution | Refusal:
        return recall.solve(pointings, memory.recall(STATED))

    return solver


def _expecting(bias: Gaussian) -> Solver:
    limit = STATED.bias_sigma_limit * STATED.bias_sigma_rad / bias.sigma  # the same angle
    trust: SolverSettings = replace(
        STATED, bias_rad=bias.mean, bias_sigma_rad=bias.sigma, bias_sigma_limit=limit
    )
    return lambda pointings: solve(pointings, trust)


def _duration_s(trial: Trial) -> float:
    """Return the length of a window by its condition, as samples may be missing at its end; 0 for lamps."""
    return float(trial.condition.removesuffix(" s")) if trial.recording else 0.0
