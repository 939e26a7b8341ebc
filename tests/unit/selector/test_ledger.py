"""Ownership of what is selected."""

from hypothesis import given
from hypothesis import strategies as st

from pointit.services.selector.ownership import Ledger

HERE = frozenset("abc")


def ledger(undo_steps: int = 20) -> Ledger:
    return Ledger(lambda _user, _now_ns: False, undo_steps=undo_steps)


def selected(kept: Ledger) -> dict[str, tuple[str, int]]:
    return {one.id: (one.user, one.since_ns) for one in kept.objects()}


def test_only_so_many_steps_are_remembered() -> None:
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
    before: list[dict[str, tuple[str, int]]] = []
    for stamp_ns, (object_id, user) in enumerate(toggles, start=1):
        state = selected(kept)
        if kept.toggle(object_id, "red", user, stamp_ns).event != "refused":
            doers.append(user)
            before.append(state)
    while doers:  # in the order in which it was done, the latest first
        assert all(record.event != "refused" for record in kept.undo(doers.pop(), 99, HERE))
        assert selected(kept) == before.pop()


def test_what_was_not_done_is_taken_back_once_also_if_the_change_was_before_a_restart() -> None:
    kept = ledger()
    restarted = ledger()
    on, off = (kept.toggle("a", "red", "anna", stamp_ns) for stamp_ns in (100, 200))
    for each in (kept, restarted):
        back = each.take_back(off, 250, "no power")
        assert back is not None
        assert (back.event, back.reason, selected(each)) == ("selected", "no power", {"a": ("anna", 250)})
        assert each.take_back(off, 260, "no power") is None
        assert each.take_back(on, 300, "no power") is not None
        assert selected(each) == {}
