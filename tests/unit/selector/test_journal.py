"""The journal: what the next selector reads, what the audit shows, and what is deleted."""

import contextlib
import random
import sqlite3
from collections.abc import Generator
from pathlib import Path
from typing import Literal

import pytest

from pointit.runtime.host.store import RETRY_EVERY_NS
from pointit.schemas import ActOutcome
from pointit.schemas.base import MAX_ID
from pointit.schemas.selection import NOT_DONE, REPEATED_REASON, ResultKind
from pointit.services.selector.audit import audit
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.journal import (
    MAX_PENDING,
    NS_PER_DAY,
    PRUNED_AT_ONCE,
    Journal,
    JournalContents,
    recent,
)
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.selector.selection_publisher import Owned, Record, event_of

S = 1_000_000_000
NOW = 1_700_000_000 * S


def selected(object_id: str, seq: int, *, stamp_ns: int = NOW, user: str = "anna") -> Record:
    return Record(
        stamp_ns, "selected", object_id, "red", user, user, stamp_ns, "dwell", "gauge", 0.75, seq=seq
    )


def ended(object_id: str, seq: int | None, *, stamp_ns: int = NOW) -> Record:
    event: Literal["left", "deselected"] = "left" if seq is None else "deselected"
    return Record(stamp_ns, event, object_id, "red", "anna", "anna", seq=seq)


def refused(object_id: str, seq: int) -> Record:
    return Record(NOW, "refused", object_id, user="ben", owner="anna", reason="hers", seq=seq)


def keep(folder: Path, *records: Record | ActOutcome, told: int = 0, now_ns: int = NOW) -> None:
    """Write records as one run does that ends well."""
    journal = Journal(folder)
    journal.begin(now_ns)
    for record in records:
        journal.add(record)
    journal.commit(now_ns)
    journal.mark_published(told)
    journal.maintain(now_ns, is_selected=True)
    journal.close()


@contextlib.contextmanager
def opened(
    folder: Path, now_ns: int = NOW + S, **settings: float
) -> Generator[tuple[Journal, JournalContents]]:
    journal = Journal(folder, **settings)
    kept = journal.begin(now_ns)
    yield journal, kept
    journal.close()


def execute(folder: Path, statement: str) -> None:
    with contextlib.closing(sqlite3.connect(folder / "journal.sqlite")) as db, db:
        db.execute(statement)


def test_journal_restores_open_selections_and_the_event_count(tmp_path: Path) -> None:
    records = [selected("a", 1), selected("b", 2), ended("b", 3), selected("c", 4), refused("a", 5)]
    records.append(ended("c", None))
    keep(tmp_path, *records, told=5)
    with opened(tmp_path) as (journal, kept):
        assert kept.entries == {"a": Owned("anna", "red", NOW, 0.75)}
        assert (kept.events, kept.unpublished, journal.problem) == (5, [], "")
        assert list(audit(journal.path)) == records


def outcome(record: Record, result: ResultKind, text: str = "") -> ActOutcome:
    return ActOutcome(
        stamp_ns=NOW + S, event="selected", object_id=record.object_id, event_ns=record.stamp_ns,
        result=result, code="error" if text else "", text=text,
    )  # fmt: skip


def test_acts_are_pending_until_history_and_audit_have_their_outcome(tmp_path: Path) -> None:
    acts = [selected(name, seq)._replace(carriers="home react-1") for seq, name in enumerate("abcd", 1)]
    over = ended("d", 5, stamp_ns=NOW + 1)
    keep(tmp_path, *acts, over, outcome(acts[0], "done"), outcome(acts[1], "failed", "no power"), told=5)
    with opened(tmp_path) as (journal, kept):
        assert kept.pending == [(acts[2], True), (acts[3], False)]
        assert [each.seq for each in recent(journal.path, 200)] == [1, 5]
        reasons = ["", f"{NOT_DONE}no power", "", "", ""]
        assert [each.reason for each in audit(journal.path)] == reasons
        journal.add(outcome(acts[3], "done"))
        journal.commit(NOW)
    with opened(tmp_path, NOW + 700 * S) as (journal, kept):
        assert (kept.pending, kept.entries) == ((), {})
        assert [each.seq for each in recent(journal.path, 200)] == [1, 4, 5]
        assert [each.reason for each in audit(journal.path)][2:5] == [f"{NOT_DONE}no selector ran", "", ""]


def test_possibly_unpublished_act_is_published_again_with_its_carriers(tmp_path: Path) -> None:
    keep(tmp_path, selected("a", 1)._replace(carriers="home react-1"))
    with opened(tmp_path) as (_journal, kept):
        [event] = [event_of(record, 1, again=True) for record in kept.unpublished]
        assert event is not None
        assert (event.carriers, event.reason) == (("home", "react-1"), REPEATED_REASON)


def test_possibly_unpublished_events_are_published_again_once(tmp_path: Path) -> None:
    keep(tmp_path, selected("a", 1), selected("b", 2), ended("x", None), ended("b", 3), told=1)
    with opened(tmp_path) as (journal, kept):
        assert [(record.event, record.object_id, record.seq) for record in kept.unpublished] == [
            ("selected", "b", 2),
            ("deselected", "b", 3),
        ]
        journal.mark_published(3)
        journal.maintain(NOW + S, is_selected=True)
    with opened(tmp_path, NOW + 2 * S) as (_, again):
        assert again.unpublished == []


def test_old_selections_are_closed_at_the_start(tmp_path: Path) -> None:
    keep(tmp_path, selected("a", 1), told=0)
    with opened(tmp_path, NOW + 601 * S, restore_within_s=600.0) as (journal, kept):
        assert (kept.entries, kept.events, list(kept.unpublished)) == ({}, 1, [])
    assert [record.event for record in audit(journal.path)] == ["selected", "left"]
    with opened(tmp_path, NOW + 602 * S) as (_, again):
        assert list(again.unpublished) == []


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE events SET confidence = 7.5",
        "UPDATE events SET owner = x'ff00'",
        "UPDATE events SET since_ns = -5",
        "UPDATE events SET cause = 'dwel!'",
        "UPDATE events SET seq = 9223372036854775807",
        "UPDATE life SET told = 'x'",
        "UPDATE life SET alive_ns = 'x'",
    ],
)
def test_invalid_rows_are_damage(tmp_path: Path, statement: str) -> None:
    keep(tmp_path, selected("a", 1))
    execute(tmp_path, statement)
    with opened(tmp_path) as (journal, kept):
        assert kept.entries == {}
        assert "was damaged" in journal.problem


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE events SET owner = x'ff00' WHERE seq = 1",
        "UPDATE events SET user = x'ff00' WHERE seq = 1",
        "UPDATE events SET user = CAST(x'ff' AS TEXT) WHERE seq = 1",
        "UPDATE events SET stamp_ns = 'x' WHERE seq = 1",
    ],
)
def test_damaged_row_of_the_past_costs_no_selection(tmp_path: Path, statement: str) -> None:
    keep(tmp_path, selected("b", 1), ended("b", 2), selected("a", 3), told=3)
    execute(tmp_path, statement)
    with opened(tmp_path) as (journal, kept):
        assert (list(kept.entries), journal.problem) == (["a"], "")
        assert kept.decided[-1] == ("anna", NOW)


def test_journal_begins_with_any_flipped_bits(tmp_path: Path) -> None:
    keep(tmp_path / "whole", selected("a", 1), selected("b", 2), told=1)
    whole = (tmp_path / "whole" / "journal.sqlite").read_bytes()
    rng = random.Random(4)
    for index in range(40):
        folder = tmp_path / str(index)
        folder.mkdir()
        damaged = bytearray(whole)
        for _ in range(rng.choice((1, 5, 50))):
            # where something stands: header, schema, rows
            at = rng.choice([at for at in range(0, len(whole), 7) if any(whole[at : at + 7])])
            damaged[at + rng.randrange(min(7, len(whole) - at))] = rng.randrange(256)
        (folder / "journal.sqlite").write_bytes(damaged)
        with opened(folder) as (journal, kept):
            selecting = SelectionEngine(SelectorConfig(), journal.add)
            selecting.restore(kept.entries, kept.events, NOW + S)
            selecting.selection(NOW + S)  # messages can be made of it
            for record in kept.unpublished:
                event_of(record, record.seq or 0, again=True)


def test_unwritable_records_are_kept_and_written_later(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    journal.begin(NOW)
    other = sqlite3.connect(journal.path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    for seq in range(1, MAX_PENDING + 10):
        journal.add(selected(f"object {seq}", seq))
        journal.commit(NOW)

    assert "cannot be written (database is locked)" in journal.problem
    other.close()
    journal.commit(NOW + S)
    assert journal.problem  # not tried again too soon

    journal.maintain(NOW + RETRY_EVERY_NS + 1, is_selected=True)
    assert journal.problem == ""
    journal.close()
    assert [record.seq for record in audit(journal.path)] == list(range(10, MAX_PENDING + 10))


def test_old_events_are_pruned_and_open_selections_stay(tmp_path: Path) -> None:
    old = NOW - 31 * NS_PER_DAY
    over = selected("over", 2, stamp_ns=old), ended("over", 3, stamp_ns=old)
    keep(tmp_path, selected("open", 1, stamp_ns=old), *over, selected("new", 4))
    with opened(tmp_path, NOW, keep_days=30.0) as (journal, _):
        journal.maintain(NOW + S, is_selected=True)
        assert [record.object_id for record in audit(journal.path)] == ["open", "new"]


def test_old_events_behind_one_of_the_future_are_pruned(tmp_path: Path) -> None:
    old = NOW - 31 * NS_PER_DAY
    late = selected("late", 1, stamp_ns=2**62), ended("late", 2, stamp_ns=2**62)
    keep(tmp_path, *late, *(refused("x", seq) for seq in range(3, 500)), now_ns=old)
    with opened(tmp_path, NOW + 31 * NS_PER_DAY) as (journal, _):
        for count in range(4):
            before = len(list(audit(journal.path)))
            journal.maintain(NOW + 31 * NS_PER_DAY + (20 * count + 1) * S, is_selected=True)
            assert before - len(list(audit(journal.path))) <= PRUNED_AT_ONCE, "so that selecting goes on"
        assert [record.object_id for record in audit(journal.path)] == ["late", "late"]


def flood(journal: Journal, *rounds: tuple[Record, ...]) -> int:
    """Commit `rounds` one after the other. Return the largest size of the journal's files, bytes."""
    largest = 0
    for count, records in enumerate(rounds):
        for record in records:
            journal.add(record)
        journal.commit(NOW + count)
        largest = max(largest, sum(path.stat().st_size for path in journal.path.parent.glob("journal*")))
    return largest


CHECKPOINT_BYTES = 5_000_000
"""SQLite's log beside the file, which it empties at 1000 pages."""


def test_flood_of_refusals_keeps_the_size_limit_and_all_selections(
    tmp_path: Path,
) -> None:
    journal = Journal(tmp_path, max_mb=0.3)
    journal.begin(NOW)
    hers = [selected(f"hers {seq}", seq) for seq in range(50)]
    over = [
        each for seq in range(50, 100, 2) for each in (selected(f"o{seq}", seq), ended(f"o{seq}", seq + 1))
    ]
    rounds = [
        tuple(refused(f"{seq} ".ljust(MAX_ID, "x"), seq) for seq in range(at, at + 20))
        for at in range(100, 6_100, 20)
    ]

    assert flood(journal, tuple(hers + over), *rounds) < 0.33e6 + CHECKPOINT_BYTES
    journal.close()
    assert journal.path.stat().st_size < 0.33e6

    with opened(tmp_path, max_mb=0.3) as (_, kept):
        pass
    assert set(kept.entries) == {one.object_id for one in hers}
    assert kept.events == 6_099
    assert [each for each in audit(journal.path) if each.event != "refused"] == hers + over
    assert sum(each.event == "refused" for each in audit(journal.path)) > 90


def test_flood_of_selections_keeps_the_size_limit_and_open_selections(
    tmp_path: Path,
) -> None:
    journal = Journal(tmp_path, max_mb=0.3)
    journal.begin(NOW)
    hers = selected("hers", 1)
    rounds = [
        (selected(f"{seq}", seq), ended(f"{seq}", seq + 1), refused("hers", seq + 2))
        for seq in range(2, 9_002, 3)
    ]
    flood(journal, (hers,), *rounds)
    journal.close()
    assert journal.path.stat().st_size < 0.33e6
    left = list(audit(journal.path))
    assert left[0] == hers
    assert left[-1].seq == 9_001
