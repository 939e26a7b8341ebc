"""Ownership of what is selected."""

from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import SelectedObject
from pointit.services.selector.ownership import Ledger, ObjectChange
from pointit.services.selector.selection_publisher import Owned

HERE = frozenset("abc")


def ledger(undo_steps: int = 20) -> Ledger:
    return Ledger(lambda _user, _now_ns: False, undo_steps=undo_steps)


def selected(kept: Ledger) -> dict[str, tuple[str, int]]:
    return {one.id: (one.user, one.since_ns) for one in kept.objects()}


def test_remembered_steps_are_limited() -> None:
    kept = ledger(undo_steps=2)
    for object_id in "abc":
        kept.toggle(object_id, "red", "anna", 1)
    assert kept.undo("anna", 2, HERE)
    assert kept.undo("anna", 2, HERE)
    assert kept.undo("anna", 2, HERE) == []
    assert set(selected(kept)) == {"a"}


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(["anna", "ben"])), max_size=40))
def test_undoing_everything_leads_back_to_nothing(toggles: list[tuple[str, str]]) -> None:
    kept = ledger(undo_steps=100)
    doers: list[str] = []
    before: list[list[SelectedObject]] = []
    for stamp_ns, (object_id, user) in enumerate(toggles, start=1):
        state = [*kept.objects()]
        if not kept.toggle(object_id, "red", user, stamp_ns).is_refused:
            doers.append(user)
            before.append(state)

    while doers:  # in the order in which it was done, the latest first
        undone = kept.undo(doers.pop(), 99, HERE)

        assert undone
        assert not any(change.is_refused for change in undone)
        assert [*kept.objects()] == before.pop()


def test_failed_change_is_taken_back_once_also_after_a_restart() -> None:
    kept = ledger()
    restarted = ledger()
    (on,) = kept.toggle("a", "red", "anna", 100).records
    (off,) = kept.toggle("a", "red", "anna", 200).records
    for each in (kept, restarted):
        back = each.take_back(off, 250, "no power")
        assert back is not None
        assert (back.event, back.reason, selected(each)) == ("selected", "no power", {"a": ("anna", 250)})
        assert each.take_back(off, 260, "no power") is None
        assert each.take_back(on, 300, "no power") is not None
        assert selected(each) == {}


def events(changes: list[ObjectChange]) -> list[tuple[str, str]]:
    return [(record.event, record.object_id) for change in changes for record in change.records]


def test_objects_stay_oldest_first_when_a_clear_is_undone() -> None:
    kept = ledger()
    for stamp_ns, object_id in enumerate("bca", start=1):
        kept.toggle(object_id, "red", "anna", stamp_ns)
    before = kept.objects()
    kept.clear("anna", 10)

    undone = kept.undo("anna", 20, HERE)

    assert kept.objects() == before
    assert events(undone) == [("selected", "b"), ("selected", "c"), ("selected", "a")]


def test_objects_stay_oldest_first_when_an_older_one_comes_back() -> None:
    kept = ledger()
    kept.toggle("a", "red", "anna", 1)
    kept.toggle("b", "red", "ben", 2)
    kept.toggle("a", "red", "anna", 3)

    kept.undo("anna", 4, HERE)

    assert [one.id for one in kept.objects()] == ["a", "b"]


def test_objects_are_oldest_first_after_a_restart() -> None:
    """A journal lists them by their last event, which an undo makes newer than their time of selection."""
    kept = ledger()

    kept.restore({"b": Owned("ben", "red", 2), "a": Owned("anna", "red", 1)})

    assert [one.id for one in kept.objects()] == ["a", "b"]


def test_take_over_is_one_change_that_switches_nothing() -> None:
    kept = ledger()
    kept.toggle("a", "red", "anna", 1)

    taken = kept.release("a", "ben", 5, take_over=True)

    assert taken is not None
    assert not taken.is_switched
    assert events([taken]) == [("deselected", "a"), ("selected", "a")]
    assert [record.owner for record in taken.records] == ["anna", "ben"]
    assert selected(kept) == {"a": ("ben", 6)}, "its two events have stamps of their own"


def test_takeover_can_be_undone_when_the_bay_is_decided() -> None:
    kept = Ledger(lambda _user, _now_ns: False, lambda _object_id, now_ns: "too late" if now_ns > 5 else "")
    kept.toggle("a", "red", "anna", 1)
    kept.release("a", "ben", 6, take_over=True)

    (given_back,) = kept.undo("ben", 7, HERE)

    assert not given_back.is_switched
    assert selected(kept) == {"a": ("anna", 1)}
    (refused,) = kept.undo("anna", 8, HERE)
    assert refused.is_refused
    assert refused.records[0].reason == "too late"


def test_undo_of_a_take_over_works_while_the_tracker_flickers() -> None:
    kept = ledger()
    kept.toggle("a", "red", "anna", 1)
    kept.release("a", "ben", 2, take_over=True)

    kept.undo("ben", 3, present=frozenset())

    assert selected(kept) == {"a": ("anna", 1)}


ACTIONS = ("toggle", "follow", "clear", "release", "take over", "undo")
"""Actions that change the owner of objects."""


def act(kept: Ledger, action: str, object_id: str, user: str, now_ns: int) -> list[ObjectChange]:
    if action == "toggle":
        return [kept.toggle(object_id, "red", user, now_ns)]
    if action == "follow":
        return [kept.follow(object_id, "red", user, now_ns)]
    if action == "clear":
        return kept.clear(user, now_ns)
    if action == "undo":
        return kept.undo(user, now_ns, HERE)
    change = kept.release(object_id, user, now_ns, take_over=action == "take over")
    return [] if change is None else [change]


@given(
    st.lists(
        st.tuples(
            st.sampled_from(ACTIONS),
            st.sampled_from("ab"),
            st.sampled_from(["anna", "ben"]),
            st.sampled_from([0, 0, 0, 1, -5]),
        ),
        max_size=40,
    )
)
def test_events_of_an_object_have_growing_stamps_by_any_clock(
    actions: list[tuple[str, str, str, int]],
) -> None:
    kept = ledger()
    stamps_ns: dict[str, list[int]] = {"a": [], "b": []}
    now_ns = 100
    for action, object_id, user, step_ns in actions:
        now_ns += step_ns  # most of the time the clock stands, and sometimes it is set back
        for change in act(kept, action, object_id, user, now_ns):
            if not change.is_refused:
                stamps_ns[change.object_id] += [record.stamp_ns for record in change.records]

    for stamps in stamps_ns.values():
        assert stamps == sorted(set(stamps))
