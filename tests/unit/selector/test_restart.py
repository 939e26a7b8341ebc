"""A selector that is killed and started again: nothing lost, nothing doubled, gaps closed."""

import json
import os
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from pointit.cli.inspect.audit import command as audit_command
from pointit.runtime.host.state_file import state_directory
from pointit.runtime.host.store import read_rows
from pointit.schemas import ConveyorState, Departure
from pointit.schemas.topics import CONVEYOR_STATE, HEALTH, OBJECTS, SELECTION, SELECTION_EVENTS
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.outputs import TOLD_AGAIN
from pointit.services.selector.service import Selector
from pointit.services.selector.store.journal import Journal
from pointit.services.selector.store.journal_table import FILE
from tests.support.bench import START_NS, ManualClock, in_virtual_time, memory_bench, until
from tests.unit.selector.test_selector_service import objects, stay


def as_left_by_a_kill(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str) -> None:
    """Go on with the files as they are now: what a process finds that comes after a kill -9."""
    copy = tmp_path / name
    shutil.copytree(os.environ["POINTIT_STATE"], copy)
    monkeypatch.setenv("POINTIT_STATE", str(copy))


@in_virtual_time
async def test_selections_survive_a_kill_and_counting_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        before, events = bench.collect(SELECTION), bench.collect(SELECTION_EVENTS)
        bench.start(Selector)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a", "b")
        await stay(bench, clock, "ben", 2.0, "a", "b")
        assert len(events) == 2
        as_left_by_a_kill(monkeypatch, tmp_path, "after")
    async with memory_bench(clock) as bench:
        after, again = bench.collect(SELECTION), bench.collect(SELECTION_EVENTS)
        bench.start(Selector)
        await bench.settle()
        assert after[0].objects == before[-1].objects
        # of the last event it was not written yet that it was told; who reads can tell that it is the same
        assert [event.model_copy(update={"reason": ""}) for event in again] == events[-len(again) :]
        assert {event.reason for event in again} == {TOLD_AGAIN}
        await stay(bench, clock, "carl", 1.0, "a", "b")
        assert [(event.event, event.user, event.seq) for event in again[-1:]] == [("refused", "carl", 3)]
        assert after[-1].objects == before[-1].objects


@in_virtual_time
async def test_a_new_run_begins_with_nothing_selected_and_the_audit_stays() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        site = bench.bus.site
        bench.start(Selector)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a", "b")
        Selector.discard_saved_state(site, clock.now_ns() + 1)  # by another run: it is in use, and stays
    Selector.discard_saved_state(site, clock.now_ns() + 1)
    async with memory_bench(clock) as bench:
        after = bench.collect(SELECTION)
        bench.start(Selector)
        await bench.settle()
        assert after[0].objects == ()
    rows = json.loads(CliRunner().invoke(audit_command, ["--site", site, "--json"]).output)["events"]
    assert [(row["event"], row["user"]) for row in rows] == [("selected", "anna"), ("left", "anna")]


def test_damaged_journal_is_logged_when_the_saved_state_is_discarded(
    caplog: pytest.LogCaptureFixture,
) -> None:
    path = state_directory() / "lab" / "selector" / FILE
    path.parent.mkdir(parents=True)
    path.write_bytes(b"damaged while it ran" * 100)
    Selector.discard_saved_state("lab", START_NS)
    [aside] = path.parent.glob("journal.corrupt-*")
    assert f"was damaged and is now {aside.name}" in caplog.text


@in_virtual_time
async def test_the_audit_says_when_and_where_left_what_left_while_no_selector_ran(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        site = bench.bus.site
        bench.start(Selector)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a", "b")
        as_left_by_a_kill(monkeypatch, tmp_path, "after")
    left_ns = clock.advance(4.0)
    clock.advance(20.0)
    async with memory_bench(clock) as bench:
        after = bench.collect(SELECTION)
        gone = Departure(object_id="a", stamp_ns=left_ns, bay="1", user="anna")
        state = ConveyorState(stamp_ns=left_ns, speed_mps=0.5, departures=(gone,))
        bench.put(CONVEYOR_STATE, state)
        bench.start(Selector)
        await bench.settle()
        assert after[-1].objects == ()
    rows = json.loads(CliRunner().invoke(audit_command, ["--site", site, "--json"]).output)["events"]
    assert [(row["event"], row["object_id"]) for row in rows] == [("selected", "a"), ("left", "a")]
    assert (rows[-1]["stamp_ns"], rows[-1]["reason"]) == (left_ns, "left at bay 1")


@in_virtual_time
async def test_a_selection_that_was_kept_but_not_published_is_published_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = ManualClock()
    commit = Journal.commit

    def commit_and_die(journal: Journal, now_ns: int) -> None:
        is_first = bool(journal._pending) and not (tmp_path / "after").exists()
        commit(journal, now_ns)
        if is_first:
            as_left_by_a_kill(monkeypatch, tmp_path, "after")

    monkeypatch.setattr(Journal, "commit", commit_and_die)
    async with memory_bench(clock) as bench:
        bench.start(Selector)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
    assert (tmp_path / "after").exists()
    monkeypatch.setattr(Journal, "commit", commit)
    async with memory_bench(clock) as bench:
        selections, events = bench.collect(SELECTION), bench.collect(SELECTION_EVENTS)
        bench.start(Selector)
        await bench.settle()
        assert [(one.id, one.user) for one in selections[-1].objects] == [("a", "anna")]
        assert [(event.event, event.object_id, event.seq) for event in events] == [("selected", "a", 1)]
        await until(lambda: _told() == 1, what="it to be written that it was told")
        as_left_by_a_kill(monkeypatch, tmp_path, "once more")
    async with memory_bench(clock) as bench:
        events = bench.collect(SELECTION_EVENTS)
        bench.start(Selector)
        await bench.settle()
        assert events == []


def _told() -> int:
    path = state_directory() / "memory" / "selector" / FILE
    return next(read_rows(path, "SELECT told FROM life", (), lambda row: int(row[0])))


@in_virtual_time
async def test_what_left_meanwhile_is_closed_after_a_grace_time() -> None:
    clock = ManualClock()
    config = SelectorConfig(unseen_after_s=30.0)
    async with memory_bench(clock) as bench:
        bench.start(Selector, config)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a", "b")
        await stay(bench, clock, "ben", 2.0, "a", "b")
    clock.advance(5.0)
    async with memory_bench(clock) as bench:
        selections = bench.collect(SELECTION)
        bench.start(Selector, config)
        await bench.settle()
        for _ in range(29):
            clock.advance(1.0)
            bench.put(OBJECTS, objects(clock, "b"), "conveyor")
            await bench.settle(3)
        assert [one.id for one in selections[-1].objects] == ["a", "b"]
        for _ in range(3):
            clock.advance(1.0)
            bench.put(OBJECTS, objects(clock, "b"), "conveyor")
            await bench.settle(3)
        assert [one.id for one in selections[-1].objects] == ["b"]
    result = CliRunner().invoke(audit_command, ["--site", "memory", "--json"])
    assert result.exit_code == 0
    story = [(event["event"], event["object_id"]) for event in json.loads(result.output)["events"]]
    assert story == [("selected", "a"), ("selected", "b"), ("left", "a")]


@in_virtual_time
async def test_a_second_selector_warns_and_works_in_memory() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        bench.start(Selector)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
        async with memory_bench(clock) as other:
            health, events = other.collect(HEALTH), other.collect(SELECTION_EVENTS)
            other.start(Selector)
            await until(lambda: bool(health), what="its health")
            assert any("another selector writes" in text for text in health[-1].warnings)
            await stay(other, clock, "ben", 1.0, "a")
            assert [(event.event, event.user) for event in events] == [("selected", "ben")]
        result = CliRunner().invoke(audit_command, ["--site", "memory", "--json"])  # while the first one runs
        assert [event["user"] for event in json.loads(result.output)["events"]] == ["anna"]


@in_virtual_time
async def test_it_can_be_told_to_keep_nothing() -> None:
    async with memory_bench() as bench:
        selections = bench.collect(SELECTION)
        bench.start(Selector, SelectorConfig.model_validate({"journal": {"enabled": False}}))
        await bench.settle()
        assert len(selections) == 1
    assert not state_directory().exists()
