"""Past events: in order, bounded, also after a restart, without delaying selection."""

import asyncio
import threading
from pathlib import Path

import pytest

from pointit.runtime.errors import RefusedError
from pointit.schemas import ReadHistory, ReadHistoryReply, SelectionEvent, encode
from pointit.schemas.topics import READ_HISTORY
from pointit.services.selector import journal as journal_file
from pointit.services.selector.journal import ENVELOPE_BYTES, History, Journal, fitting, recent
from tests.support.bench import Bench, ManualClock
from tests.unit.selector.served import served
from tests.unit.selector.test_journal import NOW, S, ended, keep, refused, selected

pytestmark = pytest.mark.wall_time


async def asked(bench: Bench, last: int = 200, since_ns: int = 0) -> tuple[SelectionEvent, ...]:
    reply = await bench.bus.call(READ_HISTORY, ReadHistory(last=last, since_ns=since_ns))
    return reply.events


def event(number: int, reason: str = "") -> SelectionEvent:
    return SelectionEvent(stamp_ns=NOW, seq=number, event="selected", object_id="a", reason=reason)


async def test_history_has_published_events_also_after_a_restart() -> None:
    clock = ManualClock()
    async with served(clock) as site:
        assert await asked(site.bench) == ()
        for user, at_m in (("anna", 1.0), ("ben", 2.0), ("carl", 1.0)):
            await site.stay(user, at_m, "a", "b")
        told = site.events
        assert [each.event for each in told] == ["selected", "selected", "refused"]
        assert list(await asked(site.bench)) == told
        assert list(await asked(site.bench, last=2)) == told[1:]
        assert list(await asked(site.bench, since_ns=told[1].stamp_ns)) == told[1:]
    async with served(clock) as site:
        assert list(await asked(site.bench)) == told


def test_history_lacks_events_that_the_selector_did_not_publish(tmp_path: Path) -> None:
    later = ended("b", 3, stamp_ns=NOW + S)
    keep(tmp_path, selected("a", 1), selected("b", 2), ended("a", None), later, refused("c", 4))
    path = Journal(tmp_path).path
    assert [record.seq for record in recent(path, 200)] == [1, 2, 3, 4]
    assert [record.seq for record in recent(path, 2)] == [3, 4]
    assert [record.seq for record in recent(path, 200, since_ns=NOW + 1)] == [3]


def test_history_has_the_newest_events_within_the_size_limit() -> None:
    events = [event(number, "x" * 5000) for number in range(200)]
    some = fitting(events)
    assert 40 < len(some) < 200
    assert list(some) == events[-len(some) :]
    reply = ReadHistoryReply(message=f"the last {len(some)} events", events=some)
    assert len(encode(reply)) <= ReadHistoryReply.max_bytes
    assert len(encode(reply)) + len(encode(events[0])) > ReadHistoryReply.max_bytes - 2 * ENVELOPE_BYTES
    assert fitting([event(1, "x" * 5000)], 5000) == ()


async def test_reading_history_blocks_neither_the_loop_nor_writing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = Journal(tmp_path)
    journal.begin(NOW)
    is_read = asyncio.Event()
    may_end = threading.Event()
    loop = asyncio.get_running_loop()

    def slow(path: Path, last: int, *, since_ns: int = 0) -> object:
        loop.call_soon_threadsafe(is_read.set)
        assert may_end.wait(60.0)
        return recent(path, last, since_ns=since_ns)

    monkeypatch.setattr(journal_file, "recent", slow)
    answer = asyncio.create_task(History(journal.path).answer(ReadHistory(), ""))
    try:
        async with asyncio.timeout(60.0):
            await is_read.wait()
        journal.add(selected("a", 1))
        journal.commit(NOW)
        assert journal.problem == ""
    finally:
        may_end.set()
    assert [each.seq for each in (await answer).events] == [1]
    journal.close()


async def test_unreadable_history_is_refused_with_a_reason(tmp_path: Path) -> None:
    async with served(journal={"enabled": False}) as site:
        with pytest.raises(RefusedError, match="keeps no journal"):
            await asked(site.bench)
    (tmp_path / "journal.sqlite").write_bytes(b"no journal" * 500)
    for path in (tmp_path / "journal.sqlite", tmp_path / "none.sqlite"):
        with pytest.raises(RefusedError, match="the journal cannot be read"):
            await History(path).answer(ReadHistory(), "")
