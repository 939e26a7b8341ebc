"""Second localizations of people with the bias that a first one told, and with another person's."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from pointit.services.localizer.estimation.estimator import Solution, solve
from pointit_lab.evaluation.localization.bias_memory import BiasMemory
from pointit_lab.evaluation.localization.localization import LIMITS, OURS, STATED, judged, off_m, outcome
from pointit_lab.evaluation.localization.scoring import Outcome, rows_of
from pointit_lab.evaluation.localization.trial import FollowRecording, LocalizationTrial
from pointit_lab.evaluation.recordings.row import Row

OWN, OTHERS = "memory", "other's memory"
"""Solvers: with the memory of the same person, and of each other person of the set."""

FIRST_S = 10.0
"""Length of first localizations; each next one begins when the one before has ended."""

SECOND_S = (2.0, 3.0)
"""Lengths of second localizations."""

REMARK = (
    "`memory`: with the elevation bias of a localization of 10 s in another recording of the person; "
    "`other's memory`: in the first one of each other person. Each pair of localizations counts; `pointit` "
    "and `without` are the same pairs without memory."
)

WITHOUT = "without"
"""Solver of the pairs of `OTHERS`, without memory."""


def memory_rows(
    followed: Sequence[FollowRecording], tick: Callable[[int], None] = lambda _: None
) -> list[Row]:
    """Return the rows of second localizations of people of `followed`, each with and without memory."""
    memories = {(each.set, each.name): memories_of(each) for each in followed}
    first_of: dict[tuple[str, str], BiasMemory] = {}
    for each in followed:
        for memory in memories[each.set, each.name][:1]:
            first_of.setdefault((each.set, each.subject), memory)
    outcomes: list[Outcome] = []
    for second in followed:
        person = (second.set, second.subject)
        others = [memory for other, memory in first_of.items() if other != person]
        own = [
            memory
            for each in followed
            if (each.set, each.subject) == person and each.name != second.name
            for memory in memories[each.set, each.name]
        ]
        for trial in second.trials(SECOND_S):
            without = _outcome(trial, OURS, None)
            for name, reference, tried in ((OWN, OURS, own), (OTHERS, WITHOUT, others)):
                outcomes += [replace(without, solver=reference)] * len(tried)
                outcomes += [_outcome(trial, name, memory) for memory in tried]
            tick(len(outcomes))
    return rows_of(outcomes)


def memories_of(first: FollowRecording) -> list[BiasMemory]:
    """Return the memory after each localization of `FIRST_S` alone, none shorter."""
    memories: list[BiasMemory] = []
    for trial in first.trials([FIRST_S]):
        memory = BiasMemory()
        if trial.start_s % FIRST_S == 0.0 and memory.learn(trial.pointings, STATED, 0.0):
            memories.append(memory)
    return memories


def _outcome(trial: LocalizationTrial, name: str, memory: BiasMemory | None) -> Outcome:
    limits = LIMITS if memory is None else memory.believed(trial.pointings, LIMITS, 0.0)
    found = outcome(trial, math.nan, name, lambda pointings: solve(pointings, limits.unlimited()))
    verdict = judged(trial.pointings, limits)
    taken_m = off_m(verdict, trial) if isinstance(verdict, Solution) else math.inf
    return replace(found, taken_m=taken_m, recording="")
