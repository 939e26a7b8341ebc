"""Localizations of people with the bias that their earlier ones told, and with another person's."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from pointit.schemas import RememberedBias
from pointit.services.localizer.estimation.bias_memory import BiasMemory
from pointit.services.localizer.estimation.estimator import Solution, solve
from pointit.services.localizer.verification import without_spikes
from pointit_lab.evaluation.localization.localization import LIMITS, OURS, STATED, judged, off_m, outcome
from pointit_lab.evaluation.localization.scoring import Outcome, rows_of
from pointit_lab.evaluation.localization.trial import FollowRecording, LocalizationTrial
from pointit_lab.evaluation.recordings.row import Row

OWN, OTHERS = "memory", "other's memory"
"""Solvers: with the memory of the same person, and of each other person of the set."""

LENGTHS_S = (2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Times at which the pose of a localization may be accepted, which ends it."""

SECOND_S = (2.0, 3.0)
"""Lengths of localizations with memory."""

PAUSE_S = 1.0
"""Time until the next localization if no pose was accepted."""

REMARK = (
    "`memory`: with the elevation bias that the person's accepted localizations told, those of other "
    "recordings and those before in the same one; `other's memory`: of all those of another person, each "
    "counts. `pointit` and `without` are the same localizations without memory."
)

WITHOUT = "without"
"""Solver of the localizations of `OTHERS`, without memory."""


def memory_rows(
    followed: Sequence[FollowRecording], tick: Callable[[int], None] = lambda _: None
) -> list[Row]:
    """Return the rows of localizations of people of `followed`, each with and without memory."""
    accepted = [list(accepted_of(each)) for each in followed]
    people = [(each.set, each.subject) for each in followed]
    memory_of = {
        person: remembered_bias(
            [each for trials, of in zip(accepted, people, strict=True) if of == person for each in trials]
        )
        for person in people
    }
    outcomes: list[Outcome] = []
    for index, second in enumerate(followed):
        person = people[index]
        others = [memory for other, memory in memory_of.items() if other != person and memory is not None]
        of_others = [
            trial
            for each, trials in enumerate(accepted)
            if people[each] == person and each != index
            for trial in trials
        ]
        own_after: dict[int, RememberedBias | None] = {}  # so many localizations of the same recording
        for trial in second.trials(SECOND_S):
            before = [each for each in accepted[index] if _end_s(each) <= trial.start_s]
            if len(before) not in own_after:
                own_after[len(before)] = remembered_bias([*of_others, *before])
            own = own_after[len(before)]
            without = _outcome(trial, OURS, None)
            tried = [(OWN, OURS, own)] if own is not None else []
            tried += [(OTHERS, WITHOUT, memory) for memory in others]
            for name, reference, memory in tried:
                outcomes += [replace(without, solver=reference), _outcome(trial, name, memory)]
            tick(len(outcomes))
    return rows_of(outcomes)


def accepted_of(recording: FollowRecording) -> Iterator[LocalizationTrial]:
    """Yield localizations one after another, each as long as it takes until its pose is accepted."""
    by_start: dict[float, list[LocalizationTrial]] = {}
    for trial in recording.trials(LENGTHS_S):
        by_start.setdefault(round(trial.start_s, 3), []).append(trial)
    free_s = -math.inf
    for start_s in sorted(by_start):
        if start_s < free_s:
            continue
        free_s = start_s + PAUSE_S
        for trial in by_start[start_s]:
            if isinstance(judged(trial.pointings), Solution):
                free_s = _end_s(trial)
                yield trial
                break


def remembered_bias(trials: Sequence[LocalizationTrial]) -> RememberedBias | None:
    """Return the bias that is remembered after these accepted localizations of one person."""
    memory = BiasMemory()
    for trial in trials:
        memory.learn(without_spikes(trial.pointings), STATED, 0.0)
    return memory.remembered


def _end_s(trial: LocalizationTrial) -> float:
    return trial.start_s + float(trial.condition.removesuffix(" s"))


def _outcome(trial: LocalizationTrial, name: str, remembered: RememberedBias | None) -> Outcome:
    memory = BiasMemory()
    memory.remembered = remembered
    limits = memory.believed(without_spikes(trial.pointings), LIMITS, 0.0)
    found = outcome(trial, math.nan, name, lambda pointings: solve(pointings, limits.unlimited()))
    verdict = judged(trial.pointings, limits)
    taken_m = off_m(verdict, trial) if isinstance(verdict, Solution) else math.inf
    return replace(found, taken_m=taken_m, recording="")
