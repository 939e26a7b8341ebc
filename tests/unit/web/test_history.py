"""Events from before the server started: queried from the selector, each once, in order."""

import logging
from collections.abc import Sequence

import msgpack
import pytest

from pointit.bridges.web.model.history import AHEAD_NS, BACK_NS, Past
from pointit.bridges.web.pages.latest_values import HISTORY, LatestValueCache
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import RefusedError
from pointit.schemas import Feedback, ReadHistory, ReadHistoryReply, SelectionEvent, encode
from pointit.schemas.topics import FEEDBACK, READ_HISTORY, SELECTION_EVENTS
from tests.support.bench import START_NS, Bench, ManualClock, memory_bench

S = 1_000_000_000


def event(number: int, stamp_ns: int, reason: str = "") -> SelectionEvent:
    return SelectionEvent(
        stamp_ns=stamp_ns, seq=number, event="selected", object_id=f"red-{number}", reason=reason
    )


class Looker:
    """A page's server: a hub that hears, and asks for what it has not heard."""

    def __init__(self, bench: Bench) -> None:
        self.hub = LatestValueCache()
        self.past = Past(ServiceBus(bench.bus, bench.clock, "web", "web", ""), bench.clock, self.hub)

    def hears(self, *events: SelectionEvent) -> None:
        for each in events:
            self.hub.put(SELECTION_EVENTS, "", encode(each), stamp_ns=each.stamp_ns)
            self.past.hear(each)

    def shows(self) -> list[tuple[str, int]]:
        """Return the past events that a page gets when it is opened now."""
        batch = self.hub.open(60.0).take(0.0)
        events = () if batch is None else batch.events
        return [(topic, msgpack.unpackb(payload)["seq"]) for topic, _, payload in events if payload]

    def shown_numbers(self) -> list[int]:
        return [number for _, number in self.shows()]


def keeps(bench: Bench, events: Sequence[SelectionEvent]) -> list[ReadHistory]:
    """Be a selector whose journal has `events`; return a list that grows with what is asked."""
    queries: list[ReadHistory] = []

    async def answer(query: ReadHistory, _name: str) -> ReadHistoryReply:
        queries.append(query)
        return ReadHistoryReply(events=tuple(events))

    bench.bus.serve(READ_HISTORY, answer)
    return queries


async def test_a_server_that_comes_late_shows_what_the_selector_kept() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        queries = keeps(bench, [event(1, START_NS - 9 * S), event(2, START_NS - 8 * S)])
        looker = Looker(bench)
        await looker.past.ask()
        assert looker.shown_numbers() == [1, 2]
        assert queries == [ReadHistory(last=HISTORY, since_ns=START_NS - BACK_NS)]


async def test_what_was_heard_too_is_shown_once_and_all_of_it_in_order() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        kept = [event(number, START_NS + number * S) for number in range(1, 7)]
        keeps(bench, kept)
        looker = Looker(bench)
        heard_again = event(2, START_NS + 2 * S, "told again after a restart of the selector")
        looker.hears(heard_again, kept[2])
        cue = Feedback(stamp_ns=START_NS + 3 * S + 1, seq=77, cue="selected")
        looker.hub.put(FEEDBACK, "anna", encode(cue), stamp_ns=cue.stamp_ns)
        looker.hears(kept[5])  # 4 and 5 were lost on the way
        feed = looker.hub.open(60.0)  # a page that is there has been told what was heard
        assert feed.take(0.0) is not None
        for _ in range(2):
            await looker.past.ask()
            selections, cues = (SELECTION_EVENTS.key, FEEDBACK.key)
            assert looker.shows() == [
                *((selections, number) for number in (1, 2, 3)),
                (cues, 77),
                *((selections, number) for number in (4, 5, 6)),
            ]
        assert feed.take(10.0) is None, "what is past does not happen again"


async def test_events_with_one_stamp_keep_their_order_and_the_newest_are_shown() -> None:
    async with memory_bench() as bench:
        keeps(bench, [event(number, START_NS) for number in range(HISTORY)])
        looker = Looker(bench)
        looker.hears(*(event(number, START_NS) for number in range(HISTORY, HISTORY + 5)))
        await looker.past.ask()
        assert looker.shown_numbers() == list(range(5, HISTORY + 5))


async def test_events_of_a_run_whose_simulated_time_was_ahead_are_left_out() -> None:
    async with memory_bench() as bench:
        keeps(bench, [event(1, START_NS + AHEAD_NS + 1), event(2, START_NS + AHEAD_NS)])
        looker = Looker(bench)
        await looker.past.ask()
        assert looker.shown_numbers() == [2]


async def test_without_an_answer_all_stays_as_it_is_and_one_line_says_so(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.DEBUG, "pointit.bridges.web.model.history")
    async with memory_bench() as bench:
        looker = Looker(bench)
        looker.hears(event(1, START_NS))
        await looker.past.ask()
        assert caplog.messages == [], "a selector that is not there yet is asked when it comes"

        async def refuse(_query: ReadHistory, _name: str) -> ReadHistoryReply:
            raise RefusedError("this selector keeps no journal")

        bench.bus.serve(READ_HISTORY, refuse)
        for _ in range(3):
            await looker.past.ask()
        assert looker.shown_numbers() == [1]
        assert caplog.messages == [
            "pages do not show what happened before they came: this selector keeps no journal"
        ]
