"""Reasons for which presses at a lamp contradict others, with the names that people know."""

import math

from pointit.bridges.home_assistant.setup.lamp_presses import angle_between, presses_at
from pointit.bridges.home_assistant.setup.stored_setup import End, StoredSetup
from pointit.scan.paced_model import SECOND, PacedTarget

SAME_RAD = math.radians(8.0)
"""Angle up to which two presses at one lamp are the same, each after a short way."""


def contradiction(state: StoredSetup, target: PacedTarget) -> str:
    """Return the reason for which a lamp contradicts the others, naming the other one, or `""`."""
    if not target.reason or not target.other:
        return target.reason
    other = label_of(state, target.other.partition("|")[0])
    return f"its presses and those at {other} look exchanged"


def repeated_contradiction(state: StoredSetup, target: tuple[str, End], reason: str) -> str:
    """Return the reason of a repeated contradiction: after the same press, the other place is wrong."""
    presses = presses_at(state.presses, target, state.place)
    for previous in state.dropped:
        is_same = previous.target == target and previous.place == state.place
        if is_same and presses and angle_between(previous, presses[-1]) < SAME_RAD:
            other = "first" if state.place == SECOND else "second"
            return f"you pointed at the same twice from here: repeat it from the {other} place"
    return reason


def label_of(state: StoredSetup, lamp: str) -> str:
    """Return the name of a chosen lamp as people know it."""
    for chosen in state.lamps:
        if chosen.id == lamp and chosen.label:
            return chosen.label
    return lamp
