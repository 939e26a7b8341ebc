"""Things at a genuine broker (mosquitto) after restarts of PointIt, its selector and Home Assistant."""

import contextlib
from collections.abc import AsyncGenerator, Iterator, Sequence
from pathlib import Path

import aiomqtt
import pytest

from pointit.cli.things import mqtt_events
from pointit.runtime.errors import RefusedError
from pointit.schemas import (
    Done,
    ReadHistory,
    ReadHistoryReply,
    SelectedObject,
    Selection,
    SelectionEvent,
    SetThing,
)
from pointit.schemas.selection import REPEATED_REASON
from pointit.schemas.topics import READ_HISTORY, SELECTION, SELECTION_EVENTS, SET_THING
from tests.support.bench import Bench, memory_bench, until
from tests.support.mqtt import broker, overheard
from tests.support.mqtt_things import ROOM, Heard, found, point, published, room, state_topic, thing, told


@pytest.fixture
def port(tmp_path: Path) -> Iterator[int]:
    with broker(tmp_path) as port:
        yield port


class Selector:
    """A selector that switches `radio`, and whose journal has the events of earlier runs."""

    def __init__(self, bench: Bench, past: Sequence[tuple[str, str]] = ()) -> None:
        self.switched: list[tuple[str, bool | None, str]] = []
        self._bench = bench
        self._past = tuple(
            SelectionEvent.model_validate(
                {"stamp_ns": number, "event": event, "object_id": "radio", "user": user}
            )
            for number, (event, user) in enumerate(past)
        )
        self.has_lamp = True
        bench.bus.serve(SET_THING, self._set)
        bench.bus.serve(READ_HISTORY, self._read)

    def select(self, *users: str) -> None:
        chosen = tuple(SelectedObject(id="radio", user=user, since_ns=1) for user in users)
        self._bench.put(SELECTION, Selection(stamp_ns=1, objects=chosen))

    async def _set(self, query: SetThing, user: str) -> Done:
        assert query.is_restored
        self.switched.append((query.thing, query.on, user))
        if not self.has_lamp:
            raise RefusedError("no button or switch radio is placed")
        self.select(*([user] if query.on else []))
        return Done(message="done")

    async def _read(self, _query: ReadHistory, _user: str) -> ReadHistoryReply:
        return ReadHistoryReply(message="read", events=self._past)


@contextlib.asynccontextmanager
async def after_a_run(port: int) -> AsyncGenerator[tuple[Bench, Heard]]:
    """Let a run leave its things, the radio switched on. Yield the bench of the next, and what it sends."""
    async with memory_bench() as bench, overheard(port, "#") as heard:
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            Selector(bench).select("anna")
            await until(lambda: "ON" in str(told(heard, state_topic(bench))), what="the switch to be on")
        await until(lambda: heard[-1][1] == b"offline", what="the end")
    async with memory_bench() as bench, overheard(port, "#") as heard:
        await until(lambda: bool(told(heard, state_topic(bench))), what="the retained state")
        heard.clear()
        yield bench, heard


async def test_a_restart_switches_nothing_off(port: int) -> None:
    """A run begins with nothing selected; the broker has retained what was on."""
    async with after_a_run(port) as (bench, heard):
        selector = Selector(bench, past=[("selected", "ben"), ("deselected", "ben"), ("selected", "anna")])
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            selector.select()
            await until(lambda: bool(told(heard, state_topic(bench))), what="the state")
            assert selector.switched == [("radio", True, "anna")]
            selector.select("anna")
            selector.select()
            await until(lambda: len(told(heard, state_topic(bench))) == 2, what="the next state")
        states = [(each["state"], each["user"]) for each in told(heard, state_topic(bench))]
        assert states == [("ON", "anna"), ("OFF", "")]


async def test_a_selection_that_was_restored_by_the_selector_is_neither_switched_nor_shown_as_off(
    port: int,
) -> None:
    async with after_a_run(port) as (bench, heard):
        selector = Selector(bench)
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: any(payload == b"online" for _, payload in heard), what="availability")
            selector.select("anna")
            await until(lambda: bool(told(heard, state_topic(bench))), what="the state")
        assert [each["state"] for each in told(heard, state_topic(bench))] == ["ON"]
        assert selector.switched == []


async def test_what_people_switched_off_while_the_broker_did_not_know_stays_off(port: int) -> None:
    async with after_a_run(port) as (bench, heard):
        selector = Selector(bench, past=[("selected", "anna"), ("deselected", "ben")])
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            selector.select()
            await until(lambda: bool(told(heard, state_topic(bench))), what="the state")
        assert [each["state"] for each in told(heard, state_topic(bench))] == ["OFF"]
        assert selector.switched == []


async def test_a_switch_that_cannot_be_switched_on_again_is_named_and_shown_as_off(
    port: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(mqtt_events, "RESTORE_PAUSES_S", (0.0, 0.01))
    async with after_a_run(port) as (bench, heard):
        selector = Selector(bench)
        selector.has_lamp = False
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            selector.select()
            await until(lambda: bool(told(heard, state_topic(bench))), what="the state")
        assert [each["state"] for each in told(heard, state_topic(bench))] == ["OFF"]
        assert selector.switched == [("radio", True, "mqtt")] * 2
        assert [text for text in caplog.messages if text.startswith("radio was on before the restart")]


async def test_a_command_of_home_assistant_has_precedence_over_what_was_on(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mqtt_events, "RESTORE_PAUSES_S", (0.0, *[0.1] * 100))
    async with after_a_run(port) as (bench, heard):
        selector = Selector(bench)
        selector.has_lamp = False
        async with published(port, bench) as watcher, aiomqtt.Client("127.0.0.1", port) as home:
            watcher.on_map(ROOM)
            selector.select()
            await until(lambda: bool(selector.switched), what="the switch to be restored")
            await home.publish(f"{state_topic(bench)}/set", b"OFF")
            await until(lambda: bool(told(heard, state_topic(bench))), what="the state")
        assert [each["state"] for each in told(heard, state_topic(bench))] == ["OFF"]


async def test_home_assistant_gets_all_again_when_it_has_started(port: int) -> None:
    """A device that was deleted there is announced again."""
    async with (
        memory_bench() as bench,
        overheard(port, "#") as heard,
        published(port, bench) as watcher,
        aiomqtt.Client("127.0.0.1", port) as home,
    ):
        watcher.on_map(ROOM)
        Selector(bench).select("anna")
        await until(lambda: "ON" in str(told(heard, state_topic(bench))), what="all")
        for topic in {topic for topic, _ in heard if topic.endswith("/config")}:
            await home.publish(topic, b"", qos=1, retain=True)
        await until(lambda: not found(heard), what="the device to be deleted")
        await home.publish("homeassistant/status", b"offline", qos=1)
        heard.clear()
        await home.publish("homeassistant/status", b"online", qos=1)
        await until(lambda: len(found(heard)) == 3, what="announcements")
        await until(lambda: "ON" in str(told(heard, state_topic(bench))), what="the state")
        events = [topic for topic, _ in heard if topic.endswith(("/screws", "/seat"))]
        assert events == [], "an event is no state"
        point(bench, "screws")
        await until(lambda: bool(told(heard, state_topic(bench).replace("radio", "screws"))), what="an event")


async def test_an_event_that_a_restarted_selector_tells_again_is_published_once(port: int) -> None:
    async with memory_bench() as bench, overheard(port, "pointit/#") as heard:
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: any(payload == b"online" for _, payload in heard), what="a connection")
            fields = {"stamp_ns": 1, "event": "selected", "object_id": "screws", "user": "anna"}
            bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(fields))
            bench.put(SELECTION_EVENTS, SelectionEvent.model_validate({**fields, "reason": REPEATED_REASON}))
            point(bench, "seat")
            await until(lambda: watcher.summary()["mqtt"]["events"] == 2, what="the events")
        assert len(told(heard, state_topic(bench).replace("radio", "screws"))) == 1


async def test_the_state_of_a_switch_that_is_gone_is_taken_back(port: int) -> None:
    """It is retained, and would be the first event of a button of that name."""
    async with after_a_run(port) as (bench, heard), published(port, bench) as watcher:
        watcher.on_map(room(thing("radio")))
        await until(lambda: (state_topic(bench), b"") in heard, what="the state")
