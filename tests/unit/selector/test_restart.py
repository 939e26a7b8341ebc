"""A selector that is killed and started again: nothing lost, nothing doubled, gaps closed."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from pointit.cli.inspect.audit import command as audit_command
from pointit.runtime.host.state_file import state_directory
from pointit.runtime.host.store import read_rows
from pointit.schemas import ConveyorState, Departure, topics
from pointit.schemas.selection import REPEATED_REASON
from pointit.services.selector.journal import FILE, Journal
from pointit.services.selector.service import Selector
from tests.support.bench import START_NS, ManualClock, memory_bench, until
from tests.unit.selector.served import objects, served

SITE = "memory"


@pytest.fixture
def kill(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[str], None]:
    """Go on with the files as they are now: what a process finds that comes after a kill -9."""

    def as_left_by_a_kill(name: str) -> None:
        shutil.copytree(os.environ["POINTIT_STATE"], tmp_path / name)
        monkeypatch.setenv("POINTIT_STATE", str(tmp_path / name))

    return as_left_by_a_kill


def audited() -> list[dict[str, Any]]:
    result = CliRunner().invoke(audit_command, ["--site", SITE, "--json"])
    assert result.exit_code == 0
    events: list[dict[str, Any]] = json.loads(result.stdout)["events"]
    return events


async def test_selections_survive_a_kill_and_counting_goes_on(kill: Callable[[str], None]) -> None:
    clock = ManualClock()
    async with served(clock) as site:
        await site.stay("anna", 1.0, "a", "b")
        await site.stay("ben", 2.0, "a", "b")
        before = site.selections[-1].objects
        events = site.events
        assert len(events) == 2
        kill("after")
    async with served(clock) as site:
        again = site.events
        assert site.selections[0].objects == before
        # of the last event it was not written yet that it was told; who reads can tell that it is the same
        assert [event.model_copy(update={"reason": ""}) for event in again] == events[-len(again) :]
        assert {event.reason for event in again} == {REPEATED_REASON}

        await site.stay("carl", 1.0, "a", "b")
        assert [(event.event, event.user, event.seq) for event in again[-1:]] == [("refused", "carl", 3)]
        assert site.selections[-1].objects == before


async def test_new_run_starts_without_selections_and_keeps_the_audit() -> None:
    clock = ManualClock()
    async with served(clock) as site:
        await site.stay("anna", 1.0, "a", "b")
        Selector.discard_saved_state(SITE, clock.now_ns() + 1)  # by another run: it is in use, and stays
    Selector.discard_saved_state(SITE, clock.now_ns() + 1)
    async with served(clock) as site:
        assert site.selections[0].objects == ()
    assert [(row["event"], row["user"]) for row in audited()] == [("selected", "anna"), ("left", "anna")]


def test_damaged_journal_is_logged_when_the_saved_state_is_discarded(
    caplog: pytest.LogCaptureFixture,
) -> None:
    path = state_directory() / "lab" / "selector" / FILE
    path.parent.mkdir(parents=True)
    path.write_bytes(b"damaged while it ran" * 100)
    Selector.discard_saved_state("lab", START_NS)
    [aside] = path.parent.glob("journal.corrupt-*")
    assert f"was damaged and is now {aside.name}" in caplog.text


async def test_audit_has_time_and_place_of_departures_without_a_selector(
    kill: Callable[[str], None],
) -> None:
    clock = ManualClock()
    async with served(clock) as site:
        await site.stay("anna", 1.0, "a", "b")
        kill("after")
    left_ns = clock.advance(4.0)
    clock.advance(20.0)
    async with memory_bench(clock) as bench:
        after = bench.collect(topics.SELECTION)
        gone = Departure(object_id="a", stamp_ns=left_ns, bay="1", user="anna")
        state = ConveyorState(stamp_ns=left_ns, speed_mps=0.5, departures=(gone,))
        bench.put(topics.CONVEYOR_STATE, state)
        bench.start(Selector)
        await bench.settle()
        assert after[-1].objects == ()

    rows = audited()
    assert [(row["event"], row["object_id"]) for row in rows] == [("selected", "a"), ("left", "a")]
    assert (rows[-1]["stamp_ns"], rows[-1]["reason"]) == (left_ns, "left at bay 1")


async def test_committed_but_unpublished_selection_is_published_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kill: Callable[[str], None]
) -> None:
    clock = ManualClock()
    commit = Journal.commit

    def commit_and_die(journal: Journal, now_ns: int) -> None:
        is_first = bool(journal._pending) and not (tmp_path / "after").exists()
        commit(journal, now_ns)
        if is_first:
            kill("after")

    monkeypatch.setattr(Journal, "commit", commit_and_die)
    async with served(clock) as site:
        await site.stay("anna", 1.0, "a")
    assert (tmp_path / "after").exists()
    monkeypatch.setattr(Journal, "commit", commit)
    async with served(clock) as site:
        assert site.owners == [("a", "anna")]
        assert [(event.event, event.object_id, event.seq) for event in site.events] == [("selected", "a", 1)]
        await until(lambda: _told() == 1, what="it to be written that it was told")
        kill("once more")
    async with served(clock) as site:
        assert site.events == []


def _told() -> int:
    path = state_directory() / SITE / "selector" / FILE
    return next(read_rows(path, "SELECT told FROM life", (), lambda row: int(row[0])))


async def test_object_that_left_during_a_restart_is_closed_later() -> None:
    clock = ManualClock()
    async with served(clock, unseen_after_s=30.0) as site:
        await site.stay("anna", 1.0, "a", "b")
        await site.stay("ben", 2.0, "a", "b")
    clock.advance(5.0)
    async with served(clock, unseen_after_s=30.0) as site:
        for seconds, left in ((29, ["a", "b"]), (3, ["b"])):
            for _ in range(seconds):
                clock.advance(1.0)
                site.bench.put(topics.OBJECTS, objects(clock, "b"), "conveyor")
                await site.bench.settle(3)
            assert [name for name, _ in site.owners] == left
    story = [(event["event"], event["object_id"]) for event in audited()]
    assert story == [("selected", "a"), ("selected", "b"), ("left", "a")]


async def test_second_selector_warns_and_works_in_memory() -> None:
    clock = ManualClock()
    async with served(clock) as first:
        await first.stay("anna", 1.0, "a")
        async with served(clock) as second:
            await until(lambda: second.warns("another selector of this site writes"), what="its health")
            await second.stay("ben", 1.0, "a")
            assert second.told == [("selected", "a", "ben")]
        assert [event["user"] for event in audited()] == ["anna"], "while the first one runs"
