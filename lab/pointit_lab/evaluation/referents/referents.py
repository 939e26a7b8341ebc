"""Shares of words understood rightly, wrongly, or asked about, and reliability of the probabilities."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from pointit.geometry import vector
from pointit.schemas import NS_PER_S, Cursor
from pointit.services.listener.referents import MODEL, ReferentModel, Spoken, Target, decide, referents
from pointit_lab.evaluation.referents.speakers import NOTHING, WORD_S, SpokenScene, Utterance, speak
from pointit_lab.evaluation.things.things import Share

NEAR_RAD = math.radians(15.0)
"""Angle within which the simpler rules take the nearest thing."""
SCENES = (
    *(SpokenScene(apart_deg=apart, words=words) for words in (1, 2) for apart in (5.0, 10.0, 20.0, 40.0)),
    SpokenScene(apart_deg=20.0, is_nothing=True),
)
End = Literal["right", "wrong", "asked", "asked wrongly", "nothing"]
"""Result for one word. `asked wrongly`: what was meant is not among the candidates."""
BINS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)


@dataclass(frozen=True)
class ReferentAnswer:
    """Result for one word by the model and the simpler rules."""

    end: End
    stated: float
    """Probability stated of what is most probable, none of all included."""
    is_best: bool
    """True if that is what was meant."""
    took_s: float
    """CPU time of the model and the decision, s: a busy machine's other work is not counted."""
    others: tuple[End, ...]
    """Results of `RULES`."""


RULES = ("cursor at the onset", "nearest at the end", "button")


def answers(model: ReferentModel, piece: tuple[SpokenScene, int, int]) -> list[ReferentAnswer]:
    """Return the answers for the words of so many people, from a seed on."""
    scene, first, count = piece
    return [each for seed in range(first, first + count) for each in answer(scene, seed, model)]


def answer(scene: SpokenScene, seed: int, model: ReferentModel = MODEL) -> list[ReferentAnswer]:
    """Return the answers for the words of one person."""
    utterance, targets = speak(scene, seed), scene.targets()
    words: tuple[Literal["that", "there"], ...] = ("that", "there")
    answers: list[ReferentAnswer] = []
    for index, (goal, at_ns) in enumerate(zip(utterance.goals, utterance.words_ns, strict=True)):
        others_ns = [each for other, each in enumerate(utterance.words_ns) if other != index]
        spoken = Spoken(at_ns=at_ns, word=words[index], others_ns=others_ns)
        first_ns, last_ns = spoken.span_ns
        near = [cursor for cursor in utterance.cursors if first_ns <= cursor.stamp_ns <= last_ns]
        started_s = time.thread_time()
        reply = referents(near, targets, spoken, model)
        decision = decide(reply, ("thing",))
        took_s = time.thread_time() - started_s
        best = max((*reply.candidates,), key=lambda one: one.probability, default=None)
        is_none = best is None or best.kind != "thing" or reply.none > best.probability
        stated = reply.none if is_none or best is None else best.probability
        is_best = goal == (NOTHING if is_none or best is None else best.name)
        names = [one.name for one in decision.candidates]
        end: End = "nothing"
        if decision.do == "act":
            end = "right" if names == [goal] else "wrong"
        elif decision.do == "ask":
            end = "asked" if goal in names else "asked wrongly"
        answers.append(ReferentAnswer(end, stated, is_best, took_s, _by_rules(utterance, index, targets)))
    return answers


def _by_rules(utterance: Utterance, index: int, targets: Sequence[Target]) -> tuple[End, ...]:
    half_ns = round(WORD_S / 2.0 * NS_PER_S)
    middle_ns, goal = utterance.words_ns[index], utterance.goals[index]
    times_ns = (middle_ns - half_ns, middle_ns + half_ns, utterance.presses_ns[index])
    return tuple(_nearest(utterance.cursors, targets, at_ns, goal) for at_ns in times_ns)


def _nearest(cursors: Sequence[Cursor], targets: Sequence[Target], at_ns: int, goal: str) -> End:
    cursor = min(cursors, key=lambda each: abs(each.stamp_ns - at_ns))
    origin_m, direction = cursor.origin_m, cursor.direction
    if origin_m is None or direction is None:
        return "nothing"
    away = {
        one.name: vector.angle_between(direction, vector.subtract(one.center_m, origin_m)) for one in targets
    }
    name = min(away, key=away.__getitem__)
    if away[name] > NEAR_RAD:
        return "nothing"
    return "right" if name == goal else "wrong"


@dataclass(frozen=True, kw_only=True)
class ReferentRow:
    """All words of a scene, by one rule."""

    scene: str
    rule: str
    right: Share
    wrong: Share
    asked: Share
    """Asked back, and what was meant is among the candidates."""
    nothing: Share
    """Not understood, or asked about other things: the person has to say it again."""


@dataclass(frozen=True, kw_only=True)
class ReliabilityRow:
    """Answers whose stated probability is in a bin."""

    low: float
    high: float
    stated: float
    right: Share


def rows_of(scene: SpokenScene, answers: Sequence[ReferentAnswer]) -> list[ReferentRow]:
    """Return the row of the model and of each simpler rule."""
    ends: list[tuple[str, list[End]]] = [("referents", [each.end for each in answers])]
    for index, rule in enumerate(RULES):
        ends.append((rule, [each.others[index] for each in answers]))

    def share(of: Sequence[End], *which: End) -> Share:
        return Share(sum(end in which for end in of), len(of))

    return [
        ReferentRow(
            scene=scene.name,
            rule=rule,
            right=share(each, "right"),
            wrong=share(each, "wrong"),
            asked=share(each, "asked"),
            nothing=share(each, "nothing", "asked wrongly"),
        )
        for rule, each in ends
    ]


def reliability(answers: Sequence[ReferentAnswer]) -> list[ReliabilityRow]:
    """Return the share of most probable answers that are right, by their stated probability."""
    rows: list[ReliabilityRow] = []
    for low, high in pairwise(BINS):
        there = [each for each in answers if low <= each.stated < high or (high == 1.0 == each.stated)]
        if there:
            stated = math.fsum(each.stated for each in there) / len(there)
            right = Share(sum(each.is_best for each in there), len(there))
            rows.append(ReliabilityRow(low=low, high=high, stated=stated, right=right))
    return rows


def times_ms(answers: Sequence[ReferentAnswer]) -> tuple[float, float]:
    """Return the median and the 99th percentile of the CPU time of an answer, ms."""
    median, p99 = np.percentile([1e3 * each.took_s for each in answers], (50, 99)).tolist()
    return median, p99
