"""Belief of the person about the interaction, from cues alone, and presses that follow from it."""

import pytest

from pointit.schemas import NS_PER_S, ButtonEvent, Feedback
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.eyes import ObservedAppearance
from pointit.services.user_sim.goal import ButtonModel, PerceivedState, State
from pointit.services.user_sim.perceived_objects import PerceivedObjects, Status
from tests.unit.user_sim.life import PRECISE, Cue, Life

WAIT = "Wait for the target to point at; press the button to cancel."
Heard = tuple[Cue, str, str]
STARTED: Heard = ("started", "Point with your arm straight.", "")
WAITING: Heard = ("started", WAIT, "")
AT_LED: Heard = ("target", "Point at led_1.", "led_1")


def after(*heard: Heard) -> PerceivedState:
    perceived = PerceivedState()
    for number, (cue, text, target) in enumerate(heard):
        perceived.on_cue(
            Feedback(stamp_ns=0, cue=cue, text=text, target_id=target, waits="wait" in text.lower()),
            number * NS_PER_S,
        )
    return perceived


@pytest.mark.parametrize(
    ("heard", "state", "target"),
    [
        ((), "idle", ""),
        ((STARTED,), "pointing", ""),
        ((WAITING,), "asked", ""),
        ((WAITING, AT_LED), "asked", "led_1"),
        ((AT_LED,), "asked", "led_1"),
        ((WAITING, AT_LED, ("localized", "", "")), "idle", ""),
        ((WAITING, AT_LED, ("localized", "", ""), STARTED), "pointing", ""),
        ((WAITING, AT_LED, ("refused", "", "")), "idle", ""),
        ((STARTED, WAITING, AT_LED, ("localized", "", "")), "pointing", ""),
        ((STARTED, AT_LED, ("refused", "", "")), "pointing", ""),
        ((STARTED, AT_LED, ("localized", "", ""), ("stopped", "", "")), "idle", ""),
        ((STARTED, AT_LED, ("stopped", "", "")), "pointing", ""),
        ((STARTED, ("stopped", "", "")), "idle", ""),
        ((STARTED, ("selected", "", ""), ("refused", "", ""), ("deselected", "", "")), "pointing", ""),
    ],
)
def test_cues_tell_where_one_is(heard: tuple[Heard, ...], state: State, target: str) -> None:
    perceived = after(*heard)
    assert (perceived.state, perceived.target) == (state, target)


def test_who_queues_knows_it_until_it_is_their_turn() -> None:
    queuing = after(WAITING, ("target", "Wait: ben is pointing at the lamps, you are next.", ""))
    assert queuing.is_queuing
    assert queuing.state == "asked"
    queuing.on_cue(Feedback(stamp_ns=0, cue="target", text="Point at led_1.", target_id="led_1"), 0)
    assert not queuing.is_queuing


def test_who_hears_of_nobody_presses_all_the_same_and_again() -> None:
    life = Life(PRECISE)
    life.run(15.0)
    assert [round(at_ns / NS_PER_S) for at_ns in life.presses] == [4, 9, 14]


def test_a_press_that_stopped_what_went_on_unknown_is_made_good() -> None:
    """A late start misses `started`: the press then stops pointing, and the next one starts it again."""
    life = Life(PRECISE)
    life.run(4.5)
    assert len(life.presses) == 1
    life.cue("stopped")
    life.run(6.0)
    assert len(life.presses) == 2
    life.cue("started")
    life.run(20.0)
    assert len(life.presses) == 2


def pressed(
    press: ButtonModel, perceived: PerceivedState, from_s: float, to_s: float, *, sees: bool | None
) -> list[ButtonEvent]:
    events = [
        press.step(round(step / 10 * NS_PER_S), perceived, known_ns=0, sees=sees)
        for step in range(round(from_s * 10), round(to_s * 10))
    ]
    return [event for event in events if event is not None]


def test_no_cursor_for_long_makes_the_person_press_and_think_anew() -> None:
    perceived = after(STARTED)
    press = ButtonModel(UserSimConfig())
    assert pressed(press, perceived, 0.0, 20.0, sees=True) == []
    assert pressed(press, perceived, 20.0, 26.0, sees=False) == []
    assert pressed(press, perceived, 26.0, 60.0, sees=None) == []  # resting meanwhile
    assert pressed(press, perceived, 60.0, 65.7, sees=False) == []
    (event,) = pressed(press, perceived, 65.7, 67.0, sees=False)
    assert event.gesture == "press"
    assert perceived.state == "idle"
    never = ButtonModel(UserSimConfig(lost_press_s=0.0))
    assert pressed(never, after(STARTED), 0.0, 100.0, sees=False) == []


S = 1_000_000_000
PLAIN = ObservedAppearance(marked=False, full=False, hidden=False, own=False, foreign=False)
FULL_OWN = ObservedAppearance(marked=True, full=True, hidden=False, own=True, foreign=False)
FULL_FOREIGN = ObservedAppearance(marked=True, full=True, hidden=False, own=False, foreign=True)
HELD = ObservedAppearance(marked=True, full=False, hidden=False, own=False, foreign=True)


def seen(
    things: PerceivedObjects, looks: ObservedAppearance, duration_s: float, since_s: float = 1.0
) -> Status:
    for step in range(round(duration_s * 10) + 1):
        things.see("a", looks, round((since_s + step / 10) * S))
    return things.status("a")


@pytest.mark.parametrize(
    ("looks", "status"), [(FULL_OWN, "mine"), (FULL_FOREIGN, "theirs"), (HELD, "taken")], ids=str
)
def test_what_is_seen_long_enough_is_believed(looks: ObservedAppearance, status: Status) -> None:
    things = PerceivedObjects()
    assert seen(things, looks, 1.0) == status
    assert seen(things, PLAIN, 0.2, since_s=3.0) == "free"


def test_what_a_cursor_covers_needs_longer_as_the_gauge_fills_the_ends_first() -> None:
    things = PerceivedObjects()
    covered = FULL_OWN._replace(hidden=True)
    assert seen(things, covered, 0.4) == "free"
    assert seen(things, PLAIN, 0.1, since_s=2.0) == "free"
    assert seen(things, covered, 0.4, since_s=3.0) == "free"  # the time starts again
    assert seen(things, covered, 0.7, since_s=4.0) == "mine"


@pytest.mark.parametrize("status", ["mine", "theirs"])
def test_a_selected_thing_under_two_cursors_is_whose_it_was(status: Status) -> None:
    things = PerceivedObjects()
    things.believe("a", status, S)
    assert seen(things, FULL_FOREIGN._replace(own=True), 3.0, since_s=2.0) == status


def test_what_cannot_be_made_out_changes_nothing_and_memory_is_bounded() -> None:
    things = PerceivedObjects()
    things.believe("a", "mine", S)
    things.see("a", None, 5 * S)
    assert things.status("a") == "mine"
    for number in range(10_100):
        things.believe(f"{number}", "mine", S)
    assert things.status("a") == "free"
