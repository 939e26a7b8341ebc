"""The last minute as MCAP, and events from before the server started."""

import base64
import io
import json
import logging
from collections.abc import Sequence
from typing import Any

import msgpack
import pytest
from mcap.reader import make_reader

import pointit.schemas as models
from pointit.bridges.web.model.history import AHEAD_NS, BACK_NS, EventHistory
from pointit.bridges.web.pages.latest_values import HISTORY, LatestValueCache
from pointit.bridges.web.playback.recent import Recent
from pointit.bridges.web.server.app import write_recording
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import RefusedError
from pointit.schemas import topics
from tests.support.bench import START_NS, Bench, ManualClock, memory_bench

START = 1_700_000_000 * models.NS_PER_S


def at(seconds: float) -> int:
    return START + round(seconds * models.NS_PER_S)


def add(recent: Recent, topic: topics.Topic[Any], message: models.Message, name: str = "") -> None:
    recent.add(message.stamp_ns, topic, name, message, models.encode(message))


def read(recent: Recent, now_ns: int, since_ns: int = 0) -> list[tuple[str, str, int, dict[str, Any]]]:
    """Return topic, schema, log time and fields of what a reader finds."""
    file = io.BytesIO()
    past = recent.past(now_ns)
    written = write_recording(past, max(past.began_ns, since_ns), file)
    file.seek(0)
    reader = make_reader(file, validate_crcs=True)
    found = [
        (channel.topic, schema.name if schema else "", message.log_time, json.loads(message.data))
        for schema, channel, message in reader.iter_messages()
    ]
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == written == len(found)
    assert all(chunk.compression == "zstd" for chunk in summary.chunk_indexes)
    return found


def cursor(seconds: float, seq: int = 0) -> models.Cursor:
    return models.Cursor(
        stamp_ns=at(seconds), seq=seq, surface="belt", surface_id="b", point_m=(1.0, 2.0, 3.0)
    )


def test_recording_is_read_back_with_topic_time_and_fields() -> None:
    minute = Recent("lab")
    add(minute, topics.CURSOR, cursor(1.0), "anna")
    add(minute, topics.FEEDBACK, models.Feedback(stamp_ns=at(2.0), cue="selected", chime="tick"), "anna")
    add(
        minute,
        topics.STRIPS_FRAME,
        models.StripsFrame(stamp_ns=at(3.0), strips=(models.StripFrame(id="s", rgb=b"\xff\xfe\x00"),)),
    )

    first, second, third = read(minute, at(4.0))
    assert first[:3] == ("/users/anna/cursor", models.Cursor.schema_name(), at(1.0))
    assert first[3]["point_m"] == [1.0, 2.0, 3.0]
    assert first[3]["stamp_ns"] == at(1.0)
    assert first[3]["origin_m"] is None
    assert second[3]["chime"] == "tick"
    assert base64.b64decode(third[3]["strips"][0]["rgb"]) == b"\xff\xfe\x00"


def test_recording_begins_with_the_states_of_before() -> None:
    minute = Recent("lab")
    minute.add(at(0.0), topics.USER_ALIVE, "anna", True, b"1")
    minute.add(at(0.0), topics.USER_ALIVE, "ben", True, b"1")
    minute.add(at(0.5), topics.USER_ALIVE, "ben", False, b"")
    add(minute, topics.MAP, models.Environment(stamp_ns=at(0.0), name="old"))
    add(minute, topics.MAP, models.Environment(stamp_ns=at(1.0), name="lab"))
    pose = models.UserPose(stamp_ns=at(2.0), position_m=(1.0, 0.0, 0.0), yaw_rad=0.0)
    add(minute, topics.POSE, pose, "anna")
    add(minute, topics.CURSOR, cursor(3.0), "anna")
    for second in range(20, 31):
        add(minute, topics.CURSOR, cursor(float(second)), "anna")
    found = read(minute, at(30.0), since_ns=at(20.0))

    assert [(topic, when) for topic, _, when, _ in found[:4]] == [
        ("/alive/users/anna", at(20.0)),
        ("/map", at(20.0)),
        ("/users/anna/pose", at(20.0)),
        ("/users/anna/cursor", at(20.0)),
    ]
    assert found[1][3]["name"] == "lab"
    assert len(found) == 14

    minute.forget(topics.POSE, "anna")
    add(minute, topics.CURSOR, cursor(31.0), "anna")
    assert "/users/anna/pose" not in {topic for topic, _, _, _ in read(minute, at(33.0), since_ns=at(32.0))}


S = 1_000_000_000


def event(number: int, stamp_ns: int, reason: str = "") -> models.SelectionEvent:
    return models.SelectionEvent(
        stamp_ns=stamp_ns, seq=number, event="selected", object_id=f"red-{number}", reason=reason
    )


class Looker:
    def __init__(self, bench: Bench) -> None:
        self.cache = LatestValueCache()
        self.past = EventHistory(
            ServiceBus(bench.bus, bench.clock, "web", "web", ""), bench.clock, self.cache
        )

    def hears(self, *events: models.SelectionEvent) -> None:
        for each in events:
            self.cache.put(topics.SELECTION_EVENTS, "", models.encode(each), stamp_ns=each.stamp_ns)
            self.past.add(each)

    def shows(self) -> list[tuple[str, int]]:
        batch = self.cache.open(60.0).take(0.0)
        events = () if batch is None else batch.events
        return [(topic, msgpack.unpackb(payload)["seq"]) for topic, _, payload in events if payload]

    def shown_numbers(self) -> list[int]:
        return [number for _, number in self.shows()]


def keeps(bench: Bench, events: Sequence[models.SelectionEvent]) -> list[models.ReadHistory]:
    """Be a selector whose journal has `events`; return a list that grows with what is asked."""
    queries: list[models.ReadHistory] = []

    async def answer(query: models.ReadHistory, _name: str) -> models.ReadHistoryReply:
        queries.append(query)
        return models.ReadHistoryReply(events=tuple(events))

    bench.bus.serve(topics.READ_HISTORY, answer)
    return queries


async def test_history_shows_received_events_once_and_in_order() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        kept = [event(number, START_NS + number * S) for number in range(1, 7)]
        queries = keeps(bench, kept)
        looker = Looker(bench)
        heard_again = event(2, START_NS + 2 * S, "told again after a restart of the selector")
        looker.hears(heard_again, kept[2])
        cue = models.Feedback(stamp_ns=START_NS + 3 * S + 1, seq=77, cue="selected")
        looker.cache.put(topics.FEEDBACK, "anna", models.encode(cue), stamp_ns=cue.stamp_ns)
        looker.hears(kept[5])  # 4 and 5 were lost on the way
        feed = looker.cache.open(60.0)  # a page that is there has been told what was heard
        assert feed.take(0.0) is not None
        for _ in range(2):
            await looker.past.ask()
            selections = topics.SELECTION_EVENTS.key
            cues = topics.FEEDBACK.key
            assert looker.shows() == [
                *((selections, number) for number in (1, 2, 3)),
                (cues, 77),
                *((selections, number) for number in (4, 5, 6)),
            ]

        assert feed.take(10.0) is None, "what is past does not happen again"
        assert queries == 2 * [models.ReadHistory(last=HISTORY, since_ns=START_NS - BACK_NS)]


async def test_history_keeps_the_order_of_events_with_one_stamp() -> None:
    async with memory_bench() as bench:
        keeps(bench, [event(number, START_NS) for number in range(HISTORY)])
        looker = Looker(bench)
        looker.hears(*(event(number, START_NS) for number in range(HISTORY, HISTORY + 5)))
        await looker.past.ask()
        assert looker.shown_numbers() == list(range(5, HISTORY + 5))


async def test_history_omits_events_of_a_simulated_time_ahead() -> None:
    async with memory_bench() as bench:
        keeps(bench, [event(1, START_NS + AHEAD_NS + 1), event(2, START_NS + AHEAD_NS)])
        looker = Looker(bench)
        await looker.past.ask()
        assert looker.shown_numbers() == [2]


async def test_history_stays_and_is_logged_without_an_answer(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.DEBUG, "pointit.bridges.web.model.history")
    async with memory_bench() as bench:
        looker = Looker(bench)
        looker.hears(event(1, START_NS))
        await looker.past.ask()
        assert caplog.messages == [], "a selector that is not there yet is asked when it comes"

        async def refuse(_query: models.ReadHistory, _name: str) -> models.ReadHistoryReply:
            raise RefusedError("this selector keeps no journal")

        bench.bus.serve(topics.READ_HISTORY, refuse)
        await looker.past.ask()
        assert looker.shown_numbers() == [1]
        assert caplog.messages == [
            "pages do not show what happened before they came: this selector keeps no journal"
        ]
