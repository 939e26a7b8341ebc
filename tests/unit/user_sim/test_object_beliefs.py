"""Beliefs about things: cues count at once, what is seen after a time."""

import pytest

from pointit.services.user_sim.sight.object_beliefs import ObjectBeliefs, Status
from pointit.services.user_sim.sight.observed_appearance import ObservedAppearance

S = 1_000_000_000
PLAIN = ObservedAppearance(marked=False, full=False, hidden=False, own=False, foreign=False)
FULL_OWN = ObservedAppearance(marked=True, full=True, hidden=False, own=True, foreign=False)
FULL_FOREIGN = ObservedAppearance(marked=True, full=True, hidden=False, own=False, foreign=True)
HELD = ObservedAppearance(marked=True, full=False, hidden=False, own=False, foreign=True)


def seen(things: ObjectBeliefs, looks: ObservedAppearance, duration_s: float, since_s: float = 1.0) -> Status:
    for step in range(round(duration_s * 10) + 1):
        things.see("a", looks, round((since_s + step / 10) * S))
    return things.status("a")


def test_new_things_are_free() -> None:
    assert ObjectBeliefs().status("a") == "free"
    assert seen(ObjectBeliefs(), PLAIN, 1.0) == "free"


@pytest.mark.parametrize(
    ("looks", "status"), [(FULL_OWN, "mine"), (FULL_FOREIGN, "theirs"), (HELD, "taken")], ids=str
)
def test_what_is_seen_long_enough_is_believed(looks: ObservedAppearance, status: Status) -> None:
    things = ObjectBeliefs()
    assert seen(things, looks, 1.0) == status
    assert seen(things, PLAIN, 0.2, since_s=3.0) == "free"


def test_what_a_cursor_covers_needs_longer_as_the_gauge_fills_the_ends_first() -> None:
    things = ObjectBeliefs()
    covered = FULL_OWN._replace(hidden=True)
    assert seen(things, covered, 0.4) == "free"
    assert seen(things, PLAIN, 0.1, since_s=2.0) == "free"
    assert seen(things, covered, 0.4, since_s=3.0) == "free"  # the time starts again
    assert seen(things, covered, 0.7, since_s=4.0) == "mine"


def test_somebody_who_only_passes_takes_nothing() -> None:
    assert seen(ObjectBeliefs(), HELD, 0.1) == "free"


def test_what_is_felt_counts_at_once_and_for_a_while() -> None:
    things = ObjectBeliefs()
    things.believe("a", "mine", S)
    assert seen(things, PLAIN, 0.3) == "mine"
    assert seen(things, PLAIN, 0.1, since_s=1.5) == "free"


@pytest.mark.parametrize("status", ["mine", "theirs"])
def test_a_selected_thing_under_two_cursors_is_whose_it_was(status: Status) -> None:
    things = ObjectBeliefs()
    things.believe("a", status, S)
    assert seen(things, FULL_FOREIGN._replace(own=True), 3.0, since_s=2.0) == status


def test_what_cannot_be_made_out_changes_nothing_and_memory_is_bounded() -> None:
    things = ObjectBeliefs()
    things.believe("a", "mine", S)
    things.see("a", None, 5 * S)
    assert things.status("a") == "mine"
    for number in range(10_100):
        things.believe(f"{number}", "mine", S)
    assert things.status("a") == "free"
