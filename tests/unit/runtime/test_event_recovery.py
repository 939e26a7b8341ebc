"""Lost events are queried until their writer answers. Later ones wait for them."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

import pytest
import zenoh

from pointit.runtime.bus.contract import EVENT_CAPACITY
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.zenoh import event_recovery
from pointit.runtime.zenoh.event_recovery import MAX_GAPS, MAX_SOURCES, EventRecovery
from tests.support.bench import until

KEY = "pointit/lab/selection/events"
OTHER = "pointit/lab/users/guest/button"


@dataclass(frozen=True)
class Id:
    zid: str = "a1"
    eid: int = 7


@dataclass(frozen=True)
class Source:
    source_sn: int
    source_id: Id = Id()


@dataclass(frozen=True)
class Heard:
    """A sample, as far as it is looked at."""

    source_info: Source | None
    key_expr: str = KEY
    payload: bytes = b""

    @property
    def err(self) -> None:
        return None

    @property
    def kind(self) -> zenoh.SampleKind:
        return zenoh.SampleKind.PUT

    @property
    def ok(self) -> "Heard":
        return self


@dataclass
class Writer:
    """Answers queries from its cache, in place of a session, while the link is up."""

    kept: range = range(0)
    cut: int = 0
    """So many questions are lost with the link."""
    after: int = 0
    """Number of answers that still come to the next query."""
    unable: int = 0
    """Number of questions that Zenoh refuses to send."""
    asked: list[str] = field(default_factory=list[str])

    def get(self, selector: str, callback: Any, **_: Any) -> None:
        if self.unable:
            self.unable -= 1
            raise zenoh.ZError("no link")
        self.asked.append(selector)
        first, last = selector.partition("_sn=")[2].split("..")
        answers = [each for each in self.kept if int(first) <= each <= int(last)]
        if self.cut:
            self.cut -= 1
            answers = answers[: self.after]
        path = selector.partition("/@adv/pub/")[2].split("/")
        writer = Id(path[0], int(path[1]))
        for each in answers:
            callback(Heard(Source(each, writer)))
        callback.drop()


@dataclass
class Reader:
    arrears: EventRecovery
    writer: Writer
    got: list[int]
    lost: list[int]

    def hear(self, *numbers: int, of: Id = Id(), key: str = KEY) -> None:
        for number in numbers:
            self.arrears.on_sample(Heard(Source(number, of), key))  # pyrefly: ignore[bad-argument-type]  # as far as it is looked at


@pytest.fixture
async def reader(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Reader]:
    monkeypatch.setattr(event_recovery, "WAITS_S", (0.0, *[0.001] * 5))
    bus = MemoryBus(LocalBroker())
    writer = Writer()
    got = list[int]()
    lost = list[int]()

    def hand_on(sample: Any) -> None:
        got.append(-1 if sample.source_info is None else sample.source_info.source_sn)

    reader = Reader(EventRecovery(bus, writer, hand_on, lost.append, max_bytes=9), writer, got, lost)  # pyrefly: ignore[bad-argument-type]  # Writer
    reader.hear(0)
    got.clear()
    yield reader
    await bus.close()


async def test_samples_without_gaps_are_passed_on_at_once(reader: Reader) -> None:
    reader.hear(1, 2, 3)
    reader.hear(0, 1, of=Id(eid=8))
    reader.arrears.on_sample(Heard(None))  # pyrefly: ignore[bad-argument-type]  # as far as it is looked at
    assert reader.got == [1, 2, 3, 0, 1, -1]
    assert not reader.writer.asked


@pytest.mark.parametrize("after", [0, 1, 2])
async def test_a_silent_writer_is_queried_again_and_order_is_kept(reader: Reader, after: int) -> None:
    reader.writer.kept = range(20)
    reader.writer.cut = 3
    reader.writer.after = after
    reader.hear(1, 5, 6)
    reader.hear(0, of=Id(eid=8))
    assert reader.got == [1, 0], "another writer's waited, or what came since did not"
    await until(lambda: len(reader.got) == 7)
    assert reader.got == [1, 0, 2, 3, 4, 5, 6]
    reader.hear(7)
    assert reader.got[-1] == 7
    assert not reader.lost
    assert reader.writer.asked[0] == "pointit/lab/selection/events/@adv/pub/a1/7/**?_sn=2..5"


@pytest.mark.parametrize(
    ("heard", "unable"),
    [((1, 3, 6), 0), ((1, 3), 2)],
    ids=["a second gap with the first", "by a session that could not ask"],
)
async def test_a_gap_is_closed(reader: Reader, heard: tuple[int, ...], unable: int) -> None:
    reader.writer.kept = range(20)
    reader.writer.unable = unable
    reader.hear(*heard)
    await until(lambda: len(reader.got) == heard[-1])
    assert (reader.got, reader.lost) == ([*range(1, heard[-1] + 1)], [])


@pytest.mark.parametrize(
    ("kept", "last", "got", "asked"),
    [(range(4, 20), 6, [1, 4, 5, 6], 1), (range(0), 4, [1, 4], 6)],
    ids=["evicted by its writer: lost at once", "of a writer that never answers: given up"],
)
async def test_samples_that_never_come_are_lost(
    reader: Reader, kept: range, last: int, got: list[int], asked: int
) -> None:
    reader.writer.kept = kept
    reader.hear(1, last)
    await until(lambda: bool(reader.lost))
    assert (reader.lost, reader.got, len(reader.writer.asked)) == ([2], got, asked)


@pytest.mark.parametrize("heard", [(3, 4), (3, 6)], ids=["no gap since", "and a gap since"])
@pytest.mark.parametrize("cut", [0, 1])
async def test_samples_of_a_new_writer_are_queried_from_its_first(
    reader: Reader, heard: tuple[int, ...], cut: int
) -> None:
    reader.writer.kept = range(1, 20)
    reader.writer.cut = cut
    reader.hear(*heard, of=Id(eid=8))
    assert reader.got == []
    await until(lambda: len(reader.got) == heard[-1])
    assert reader.got == [*range(1, heard[-1] + 1)]
    assert not reader.lost, "what is older than the reader"


async def test_a_writer_that_keeps_nothing_is_asked_three_times(reader: Reader) -> None:
    reader.hear(3, 4, of=Id(eid=8))
    await until(lambda: len(reader.got) == 2)
    assert (reader.got, reader.lost, len(reader.writer.asked)) == ([3, 4], [], 3)


async def test_samples_that_come_late_by_themselves_close_their_gap(reader: Reader) -> None:
    reader.hear(1, 4, 2, 3)
    await until(lambda: len(reader.got) == 4)
    reader.hear(5)
    assert (reader.got, reader.lost, reader.writer.asked) == ([1, 2, 3, 4, 5], [], [])


async def test_only_so_many_are_held(reader: Reader, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_recovery, "WAITS_S", (60.0,))
    reader.hear(1, *range(3, 3 + EVENT_CAPACITY))
    assert reader.got == [1, *range(3, 3 + EVENT_CAPACITY)]
    assert reader.lost == [1]
    reader.hear(3 + EVENT_CAPACITY)
    assert reader.got[-1] == 3 + EVENT_CAPACITY


async def test_more_than_anybody_keeps_is_lost_without_being_asked_for(reader: Reader) -> None:
    far = 10 * EVENT_CAPACITY
    reader.writer.kept = range(far + 1)
    reader.hear(far)
    await until(lambda: bool(reader.lost))
    assert reader.lost == [far - 1 - EVENT_CAPACITY]
    assert reader.got == [*range(far - EVENT_CAPACITY, far + 1)]
    reader.hear(far, of=Id(eid=8))
    await until(lambda: len(reader.got) == 2 * (EVENT_CAPACITY + 1))
    assert len(reader.lost) == 1, "what a writer sent before the reader began is not lost"


async def test_gaps_beyond_the_limit_are_not_queried(reader: Reader) -> None:
    made_up = [Id(eid=eid) for eid in range(100, 100 + 2 * MAX_GAPS)]
    for each in made_up:
        reader.hear(5000, of=each)
    assert reader.got == [5000] * MAX_GAPS, "handed on at once"
    reader.hear(5003, of=made_up[-1])
    assert (reader.got[-1], reader.lost) == (5003, [2])
    await until(lambda: len(reader.got) == 2 * MAX_GAPS + 1)
    reader.writer.kept = range(10)
    reader.hear(1, 4)
    await until(lambda: reader.got[-4:] == [1, 2, 3, 4])


async def test_only_so_many_writers_are_remembered(reader: Reader) -> None:
    for eid in range(100, 100 + MAX_SOURCES):
        reader.hear(0, of=Id(eid=eid))
    reader.hear(9)
    assert reader.got[-1] == 9, "evicted, and not asked for what was handed on before"
    reader.hear(9, of=Id(eid=99 + MAX_SOURCES))
    await asyncio.sleep(0)
    assert len(reader.got) == MAX_SOURCES + 1


async def test_a_closed_reader_gets_nothing_more(reader: Reader) -> None:
    reader.writer.kept = range(20)
    reader.hear(1, 4)
    reader.arrears.close()
    await asyncio.sleep(0.05)
    assert reader.got == [1]
    assert not reader.writer.asked


async def test_numbers_of_a_source_are_counted_for_each_key(reader: Reader) -> None:
    reader.writer.kept = range(20)
    reader.hear(2**31, key=OTHER)
    reader.hear(1, 2)
    assert reader.got == [1, 2]
    reader.hear(5)
    reader.hear(3, 4, key=OTHER)
    assert reader.got == [1, 2], "the events of another key stand for none that is missing"
    await until(lambda: len(reader.got) >= 5)
    assert reader.got[:5] == [1, 2, 3, 4, 5]


async def test_sources_of_another_key_evict_none_and_leave_queries_to_all(reader: Reader) -> None:
    reader.writer.kept = range(20)
    for eid in range(MAX_SOURCES + 1):
        reader.hear(5000, of=Id("b2", eid), key=OTHER)
    passed_on = len(reader.got)
    reader.hear(0)
    assert len(reader.got) == passed_on, "it is known, and was delivered before"
    reader.hear(1, 4)
    await until(lambda: [number for number in reader.got if number < 5000] == [1, 2, 3, 4])
    assert not reader.lost


async def test_event_that_waits_is_replaced_by_no_other(reader: Reader) -> None:
    waiting = Heard(Source(3), payload=b"first")
    handed_on: list[Any] = []
    reader.arrears._hand_on = handed_on.append
    reader.arrears.on_sample(waiting)  # pyrefly: ignore[bad-argument-type]  # as far as it is looked at
    reader.arrears.on_sample(Heard(Source(3), payload=b"second"))  # pyrefly: ignore[bad-argument-type]  # as above
    await until(lambda: bool(handed_on))
    assert handed_on == [waiting]


def heartbeat(number: int, key: str = KEY, of: Id = Id()) -> Any:
    payload = number.to_bytes(4, "little")

    class Payload(bytes):
        def to_bytes(self) -> bytes:
            return payload

    return Heard(None, f"{key}/@adv/pub/{of.zid}/{of.eid}/_", Payload(payload))


async def test_last_event_that_was_lost_is_queried_after_a_heartbeat(reader: Reader) -> None:
    reader.writer.kept = range(20)
    reader.arrears.on_heartbeat(heartbeat(0))
    await asyncio.sleep(0)
    assert not reader.writer.asked
    reader.arrears.on_heartbeat(heartbeat(3))
    await until(lambda: reader.got == [1, 2, 3])
    reader.hear(3, 4)
    assert reader.got == [1, 2, 3, 4]
    reader.arrears.on_heartbeat(heartbeat(2**31, OTHER))
    reader.hear(5)
    assert reader.got[-1] == 5
    for broken in (heartbeat(9, "x", Id(eid="a")), Heard(None, "x"), Heard(None, f"{KEY}/@adv/pub/a1/7/_")):  # pyrefly: ignore[bad-argument-type]  # no number
        reader.arrears.on_heartbeat(broken)  # pyrefly: ignore[bad-argument-type]  # as far as it is looked at
    assert not reader.lost


async def test_heartbeats_that_run_ahead_make_no_reader_remember_ever_more(reader: Reader) -> None:
    """A heartbeat costs its writer four bytes, so what the reader keeps for it must have an end."""
    steps = 40
    for step in range(1, steps + 1):
        reader.arrears.on_heartbeat(heartbeat(step * EVENT_CAPACITY))
    (gap,) = reader.arrears._keys[KEY].gaps.values()
    assert len(gap.wanted) <= EVENT_CAPACITY
    await until(lambda: bool(reader.lost))
    assert reader.lost == [steps * EVENT_CAPACITY], "each lost event counts, whether it was asked for or not"


async def test_event_that_comes_after_it_was_given_up_is_delivered_and_not_lost(
    reader: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = 2 * EVENT_CAPACITY
    answer = reader.writer.get

    def get(selector: str, callback: Any, **options: Any) -> None:
        reader.arrears.on_heartbeat(heartbeat(far))  # the writer goes on while it is asked
        answer(selector, callback, **options)

    monkeypatch.setattr(reader.writer, "get", get)
    reader.writer.kept = range(far + 1)
    reader.hear(1, 3)
    await until(lambda: len(reader.got) == EVENT_CAPACITY + 3)
    assert reader.got == [1, 2, 3, *range(far - EVENT_CAPACITY + 1, far + 1)]
    assert reader.lost == [far - EVENT_CAPACITY - 3]


@pytest.mark.parametrize("heard", [(1,), (1, 5)], ids=["after the gap", "in the gap"])
async def test_event_that_is_too_long_is_handed_on_at_once(reader: Reader, heard: tuple[int, ...]) -> None:
    """Nobody takes it, so a few hundred of them must not fill the memory of the reader."""
    reader.writer.kept = range(6)
    reader.hear(*heard)
    reader.arrears.on_sample(Heard(Source(3), payload=bytes(10)))  # pyrefly: ignore[bad-argument-type]  # as far as it is looked at
    assert reader.got == [1, 3], "a reader counts it as one that it does not take"
    await until(lambda: not reader.arrears._keys[KEY].gaps)
    assert reader.got == [1, 3, 2, 4, 5][: 3 if heard == (1,) else 5]
    assert not reader.lost


async def test_reader_may_close_by_an_event_that_has_waited(reader: Reader) -> None:
    """A tap gets each event at once, and may need no further one."""
    got = list[int]()

    def hand_on(sample: Any) -> None:
        got.append(sample.source_info.source_sn)
        reader.arrears.close()

    reader.arrears._hand_on = hand_on
    reader.writer.kept = range(4)
    reader.hear(3)
    await until(lambda: got == [1, 2, 3])
    assert not reader.arrears._keys[KEY].gaps
