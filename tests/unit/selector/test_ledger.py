"""Ownership of what is selected."""

from hypothesis import given
from hypothesis import strategies as st

from pointit.services.selector.ledger import Ledger


def selected(ledger: Ledger) -> dict[str, tuple[str, int]]:
    return {o.id: (o.user, o.since_ns) for o in ledger.selection(0).objects}


def test_a_toggle_selects_and_the_next_deselects() -> None:
    ledger = Ledger()
    first = ledger.toggle("a", "red", "anna", 5)
    assert (first.event, first.object_id, first.kind, first.user, first.stamp_ns) == (
        "selected",
        "a",
        "red",
        "anna",
        5,
    )
    assert selected(ledger) == {"a": ("anna", 5)}
    assert ledger.toggle("a", "red", "anna", 9).event == "deselected"
    assert selected(ledger) == {}


def test_only_the_owner_deselects() -> None:
    ledger = Ledger()
    ledger.toggle("a", "red", "anna", 5)
    event = ledger.toggle("a", "red", "ben", 6)
    assert event.event == "refused"
    assert event.user == "ben"
    assert "anna" in event.reason
    assert selected(ledger) == {"a": ("anna", 5)}


def test_what_is_of_somebody_who_is_gone_anybody_deselects() -> None:
    ledger = Ledger()
    ledger.toggle("a", "red", "anna", 5)
    ledger.set_gone("anna", gone=True)
    ledger.set_gone("anna", gone=False)
    assert ledger.toggle("a", "red", "ben", 6).event == "refused"
    ledger.set_gone("anna", gone=True)
    event = ledger.toggle("a", "red", "ben", 7)
    assert (event.event, event.user) == ("deselected", "ben")
    assert selected(ledger) == {}


def test_clear_takes_only_the_persons_own() -> None:
    ledger = Ledger()
    for object_id, user in (("a", "anna"), ("b", "ben"), ("c", "anna")):
        ledger.toggle(object_id, "red", user, 1)
    assert [(e.event, e.object_id, e.kind) for e in ledger.clear("anna", 2)] == [
        ("deselected", "a", "red"),
        ("deselected", "c", "red"),
    ]
    assert set(selected(ledger)) == {"b"}
    assert ledger.clear("anna", 3) == []


def test_what_left_is_no_longer_selected() -> None:
    ledger = Ledger()
    ledger.toggle("a", "red", "anna", 1)
    ledger.toggle("b", "red", "anna", 1)
    assert not ledger.keep({"a", "b", "c"})
    assert ledger.keep({"b"})
    assert set(selected(ledger)) == {"b"}


objects = st.sampled_from("abc")
users = st.sampled_from(["anna", "ben"])


@given(st.lists(st.tuples(objects, users), max_size=40))
def test_events_tell_the_same_story_as_the_selection(toggles: list[tuple[str, str]]) -> None:
    ledger = Ledger()
    story: dict[str, str] = {}
    seqs: list[int] = []
    for object_id, user in toggles:
        event = ledger.toggle(object_id, "red", user, 1)
        seqs.append(event.seq)
        if event.event == "selected":
            assert object_id not in story
            story[object_id] = user
        elif event.event == "deselected":
            assert story.pop(object_id) == user
        else:
            assert story[object_id] != user
        assert {o: owner for o, (owner, _) in selected(ledger).items()} == story
    assert seqs == list(range(1, len(toggles) + 1))
