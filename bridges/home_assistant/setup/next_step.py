"""The person's next step in the set-up of a home, in one sentence, with the choices that they have.

It is the only source of that sentence: the card shows it, and so do phone, panel, headset and voice.
"""

from dataclasses import dataclass

from pointit.bridges.home_assistant.setup.contradiction import label_of
from pointit.bridges.home_assistant.setup.progress import SetupProgress
from pointit.bridges.home_assistant.setup.stored_setup import StoredSetup
from pointit.scan.paced_model import FIRST, SECOND
from pointit.schemas import StepChoice
from pointit.schemas.base import MAX_ID
from pointit.schemas.home import HomePlace
from pointit.schemas.text import one_line

MAX_TEXT = 200
"""Limit of `Say.text`."""
MAX_NAME = 40
WAIT = "Wait: your home does not answer. It goes on by itself."
WALK = "Walk about two metres to your left, and look at the lamps again."
SHORT_WALK = (
    "That was less than a step, so no distance was learned. Walk further to your left, or stay in one place."
)
TRY_BY_MOUSE = "Take the arm with the mouse, and stay on a lamp: it switches."
READY = "Your home is ready: point at a lamp, and stay on it."

TAKE_BACK = StepChoice(id="take_back", label="Take back")
SKIP = StepChoice(id="skip", label="Leave it out")
STAY = StepChoice(id="stay", label="I stay here")


@dataclass(frozen=True)
class NextStep:
    """A sentence of at most `MAX_TEXT` characters, and choices. They are acts without values."""

    text: str
    choices: tuple[StepChoice, ...] = ()


def next_step(progress: SetupProgress, *, is_lit: bool, goes_off: bool, is_waiting: bool) -> NextStep | None:
    """Return the next step, or None if no card tells the person what to do with their arm.

    Args:
        progress: of the set-up.
        is_lit: the lamp whose turn it is shows it by its light.
        goes_off: that lamp reports no state, so it is off afterwards.
        is_waiting: the home does not answer.
    """
    step = _next_step(progress, is_lit=is_lit, goes_off=goes_off, is_waiting=is_waiting)
    if step is None:
        return None
    return NextStep(one_line(step.text, MAX_TEXT), step.choices)


def _next_step(progress: SetupProgress, *, is_lit: bool, goes_off: bool, is_waiting: bool) -> NextStep | None:
    state = progress.state
    if state.step not in ("place", "try") and not progress.is_aligning:
        return None
    if is_waiting:
        return NextStep(WAIT)
    if progress.is_aligning:
        return _align(progress, is_lit=is_lit)
    if state.step == "try":
        return _try(progress)
    if progress.beside:
        return _question(progress)
    if state.is_short_walk:
        return NextStep(SHORT_WALK, (StepChoice(id="walk", label="I am further away now"), STAY))
    if progress.may_walk:
        there = StepChoice(id="walk", label="I am there")
        return NextStep(WALK, (there, STAY, TAKE_BACK))
    if progress.target is None:
        return None
    return _point(progress, is_lit=is_lit, goes_off=goes_off)


def _try(progress: SetupProgress) -> NextStep:
    """Return the lamp that is tried next: it is met when it reacts, or corrected."""
    lamp = progress.tried_lamp
    done = StepChoice(id="finish", label="Done")
    if progress.state.hand == "mouse":
        return NextStep(TRY_BY_MOUSE, (done,))
    if not lamp:
        return NextStep(READY, (done,))
    name = _name(progress, lamp)
    yes = StepChoice(id="met", label="Yes")
    other = StepChoice(id="other", label="That is another one")
    aside = StepChoice(id="skip", label="Not now")
    return NextStep(f"Point elsewhere, then at {name}, and stay on it. Did it switch?", (yes, other, aside))


def _align(progress: SetupProgress, *, is_lit: bool) -> NextStep:
    lit = ", which is lit" if is_lit else ""
    place = place_name(progress.place)
    text = f"Stand at your {place}. Point at {_target_name(progress)}{lit}, and press."
    skip = StepChoice(id="skip", label="Skip")
    return NextStep(text, () if progress.state.step == "place" else (skip,))


def _question(progress: SetupProgress) -> NextStep:
    """Return the question after a press in the direction of another lamp."""
    other = _name(progress, progress.beside)
    target = _target_name(progress)
    text = f"You pointed there for {other}. Point elsewhere, then at {target}. Or is it right beside {other}?"
    yes = StepChoice(id="beside", label="Right beside it")
    wrong = StepChoice(id="mistaken", label=one_line(f"{other} was wrong", MAX_ID))
    return NextStep(text, (yes, wrong))


def _point(progress: SetupProgress, *, is_lit: bool, goes_off: bool) -> NextStep:
    """Return the turn of a lamp, with its number, and the reason if it comes once more."""
    state = progress.state
    number, count = _count(progress)
    lit = ", which is lit" if is_lit else ""
    stand = ""
    if not any(press.place == state.place for press in state.presses):
        stand = "Stand where you will point from most. " if state.place == FIRST else ""
    target = progress.target
    reason = "" if target is None else progress.reason_of(target[0])
    if reason:
        text = f"Point at {_target_name(progress)}{lit}, once more: {reason}"
    else:
        lamp = f"{_target_name(progress)} ({number} of {count}){lit}"
        text = f"{stand}Point at {lamp}, with a straight arm, and press"
    if not text.endswith((".", "?")):
        text = f"{text}."
    if goes_off:
        text = f"{text} It is switched off afterwards."
    choices = (SKIP, TAKE_BACK) if state.presses else (SKIP,)
    return NextStep(text, choices)


def _count(progress: SetupProgress) -> tuple[int, int]:
    """Return the number of the target among those of this place, and how many there are."""
    state = progress.state
    pressed = {press.target for press in state.presses if press.place == state.place}
    count = len(progress.targets)
    return min(len(pressed) + 1, count), count


def _name(progress: SetupProgress, lamp: str) -> str:
    return one_line(label_of(progress.state, lamp), MAX_NAME)


def _target_name(progress: SetupProgress) -> str:
    target = progress.target
    if target is None:
        return ""
    lamp, end = target
    name = _name(progress, lamp)
    if not end:
        return name
    return f"the {'beginning' if end == 'first' else 'end'} of {name}"


def place_name(place: str) -> str:
    """Return the name of a place as people know it: they are asked to walk from the first to the second."""
    return "second place" if place == SECOND else "first place"


def places_to_repeat(state: StoredSetup) -> tuple[HomePlace, ...]:
    """Return the places from which a lamp can be pointed at once more."""
    if state.hand not in ("phone", "wrist") or not state.presses:
        return ()
    has_second = any(press.place == SECOND for press in state.presses)
    return (FIRST, SECOND) if has_second else (FIRST,)
