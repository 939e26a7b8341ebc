"""Things of a run on a genuine MQTT broker (mosquitto), as Home Assistant would find and follow them."""

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import aiomqtt
import pytest
from ha_mqtt_discoverable.sensors import SwitchInfo

from pointit.cli.things import mqtt_events
from pointit.cli.things.mqtt_events import MqttThings, broker_of
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.schemas import (
    Done,
    Environment,
    ReadHistory,
    ReadHistoryReply,
    SelectedObject,
    Selection,
    SelectionEvent,
    SetThing,
)
from pointit.schemas.environment import Thing, ThingMode
from pointit.schemas.topics import READ_HISTORY, SELECTION, SELECTION_EVENTS, SET_THING
from pointit.services.selector.outputs import TOLD_AGAIN
from tests.support.bench import Bench, memory_bench, until
from tests.support.buses import free_port
from tests.support.mqtt import broker, overheard

Heard = list[tuple[str, bytes]]


@pytest.fixture
def port(tmp_path: Path) -> Iterator[int]:
    with broker(tmp_path) as port:
        yield port


def thing(name: str, mode: ThingMode = "button", label: str = "") -> Thing:
    return Thing(id=name, center_m=(1.0, 2.0, 1.0), size_m=(0.2, 0.2, 0.2), mode=mode, label=label)


def room(*things: Thing) -> Environment:
    return Environment(stamp_ns=1, name="shop", things=things)


ROOM = room(thing("screws", label="Screws, 4 mm"), thing("radio", "switch"), thing("seat", "claim"))


@contextlib.asynccontextmanager
async def published(port: int, bench: Bench) -> AsyncGenerator[MqttThings]:
    watcher = MqttThings(broker_of(f"127.0.0.1:{port}"))
    listening = watcher.attach(bench.bus, lambda _text, _user: None)
    try:
        yield watcher
    finally:
        for each in listening:
            each.close()
        ended = [task for task in asyncio.all_tasks() if task.get_name().endswith("by MQTT")]
        await asyncio.gather(*ended, return_exceptions=True)


def point(bench: Bench, name: str, event: str = "selected") -> None:
    fields = {"stamp_ns": 1, "event": event, "object_id": name, "user": "anna", "confidence": 0.9}
    bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(fields))


def found(heard: Heard) -> Mapping[str, Any]:
    """Return the announcements that are in force, by their kind and the id of their thing."""
    last = {topic: payload for topic, payload in heard if topic.endswith("/config")}
    split = {topic: topic.split("/") for topic in last}
    return {f"{split[topic][1]} {split[topic][3]}": json.loads(text) for topic, text in last.items() if text}


def told(heard: Heard, topic: str) -> list[Any]:
    return [json.loads(payload) for at, payload in heard if at == topic]


async def test_each_thing_is_announced_and_what_is_pointed_at_arrives(port: int) -> None:
    async with memory_bench() as bench, overheard(port, "#") as heard, published(port, bench) as watcher:
        watcher.on_map(ROOM)
        await until(lambda: len(found(heard)) == 3, what="announcements")
        screws, seat = found(heard)["event screws"], found(heard)["event seat"]
        radio = found(heard)["switch radio"]
        assert (screws["name"], screws["event_types"]) == ("Screws, 4 mm", ["pointed"])
        assert seat["event_types"] == ["pointed", "released"]
        assert SwitchInfo.model_validate(radio).unique_id == radio["unique_id"]
        assert len({each["unique_id"] for each in (screws, seat, radio)}) == 3
        assert "availability_topic" not in screws, "an event that comes back looks like one that happens"
        await until(lambda: (radio["availability_topic"], b"online") in heard, what="availability")
        assert told(heard, radio["state_topic"]) == [], "nobody knows it yet"
        bench.put(SELECTION, Selection(stamp_ns=1))
        await until(lambda: bool(told(heard, radio["state_topic"])), what="the state of the switch")
        for name in ("screws", "seat", "radio"):
            point(bench, name)
            point(bench, name, "deselected")
        chosen = SelectedObject(id="radio", user="anna", since_ns=1, confidence=0.9)
        bench.put(SELECTION, Selection(stamp_ns=2, objects=(chosen,)))
        pointed = {"event_type": "pointed", "user": "anna", "confidence": 0.9}
        await until(lambda: len(told(heard, seat["state_topic"])) == 2, what="events")
        assert told(heard, screws["state_topic"]) == [pointed], "that a button is over is no event"
        assert told(heard, seat["state_topic"]) == [pointed, {**pointed, "event_type": "released"}]
        await until(
            lambda: (
                told(heard, radio["state_topic"])
                == [
                    {"state": "OFF", "user": "", "confidence": None},
                    {"state": "ON", "user": "anna", "confidence": 0.9},
                ]
            ),
            what="the switch to be on, with all attributes",
        )
        assert watcher.summary()["mqtt"] == {"events": 3, "dropped": 0, "problem": ""}
    await until_retained(port, radio["availability_topic"], b"offline")


async def until_retained(port: int, topic: str, payload: bytes) -> None:
    async with overheard(port, topic) as heard:
        await until(lambda: bool(heard) and heard[-1][1] == payload, what=f"{topic} to be {payload!r}")


async def test_a_thing_that_is_gone_is_taken_back_also_after_a_restart(port: int) -> None:
    async with memory_bench() as bench, overheard(port, "homeassistant/#") as heard:
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: len(found(heard)) == 3, what="announcements")
            watcher.on_map(room(thing("screws", "switch"), thing("radio", "switch")))
            await until(lambda: set(found(heard)) == {"switch screws", "switch radio"}, what="the other map")
        async with published(port, bench) as watcher:
            watcher.on_map(room())
            await until(lambda: not found(heard), what="all to be taken back")


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
        self.switched.append((query.thing, query.on, user))
        if not self.has_lamp:
            raise RefusedError("there is no button or switch radio now")
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


def state_topic(bench: Bench) -> str:
    return f"pointit/{bench.bus.site}/things/radio"


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
            bench.put(SELECTION_EVENTS, SelectionEvent.model_validate({**fields, "reason": TOLD_AGAIN}))
            point(bench, "seat")
            await until(lambda: watcher.summary()["mqtt"]["events"] == 2, what="the events")
        assert len(told(heard, state_topic(bench).replace("radio", "screws"))) == 1


async def test_the_state_of_a_switch_that_is_gone_is_taken_back(port: int) -> None:
    """It is retained, and would be the first event of a button of that name."""
    async with after_a_run(port) as (bench, heard), published(port, bench) as watcher:
        watcher.on_map(room(thing("radio")))
        await until(lambda: (state_topic(bench), b"") in heard, what="the state")


async def test_lost_events_are_one_line_of_the_log_and_all_are_counted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with memory_bench() as bench, published(free_port(), bench) as watcher:
        watcher.on_map(ROOM)
        for _ in range(5):
            point(bench, "screws")
        await until(lambda: watcher.summary()["mqtt"]["dropped"] == 5, what="the events")
    assert len([text for text in caplog.messages if "is lost" in text]) == 1


async def test_what_is_pointed_at_without_a_broker_is_counted_and_never_told_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mqtt_events, "RETRY_S", 0.1)
    port = free_port()
    async with memory_bench() as bench, published(port, bench) as watcher:
        watcher.on_map(ROOM)
        await until(lambda: "cannot be reached" in watcher.summary()["mqtt"]["problem"], what="the problem")
        point(bench, "screws")
        await until(lambda: watcher.summary()["mqtt"]["dropped"] == 1, what="the event")
        with broker(tmp_path, port):
            async with overheard(port, "#") as heard:
                await until(lambda: len(found(heard)) == 3, what="announcements")
                topic = found(heard)["event screws"]["state_topic"]
                point(bench, "screws")
                await until(lambda: bool(told(heard, topic)), what="the next event")
                assert watcher.summary()["mqtt"] == {"events": 1, "dropped": 1, "problem": ""}
        await until(lambda: watcher.summary()["mqtt"]["problem"] != "", what="the loss of the broker")
        point(bench, "screws")
        await until(lambda: watcher.summary()["mqtt"]["dropped"] == 2, what="the event")
        with broker(tmp_path, port):
            async with overheard(port, "#") as heard:
                await until(lambda: len(found(heard)) == 3, what="announcements to a broker that forgot them")
                assert told(heard, topic) == []


async def test_a_switch_obeys_the_broker_and_nothing_else_does(port: int) -> None:
    asked: list[tuple[str, bool | None]] = []

    async def answer(query: SetThing, user: str) -> Done:
        assert user == "mqtt"
        asked.append((query.thing, query.on))
        if query.on is False:
            raise RefusedError("not now")
        return Done(message="done")

    async with memory_bench() as bench, overheard(port, "#") as heard, published(port, bench) as watcher:
        bench.bus.serve(SET_THING, answer)
        watcher.on_map(ROOM)
        await until(lambda: "switch radio" in found(heard), what="announcements")
        topic = found(heard)["switch radio"]["command_topic"]
        async with aiomqtt.Client("127.0.0.1", port) as home:
            for payload in (b"ON", b"on?", b"\xff", b"OFF"):
                await home.publish(topic, payload)
            for other in ("screws", "nothing", "a b"):
                await home.publish(topic.replace("radio", other), b"ON")
            await home.publish(topic, b"ON")
            await until(lambda: len(asked) == 3, what="the commands")
        assert asked == [("radio", True), ("radio", False), ("radio", True)]


async def test_a_command_that_the_broker_has_kept_is_of_another_time(
    port: int, caplog: pytest.LogCaptureFixture
) -> None:
    async with memory_bench() as bench, overheard(port, "#"):
        topic = f"pointit/{bench.bus.site}/things/radio/set"
        async with aiomqtt.Client("127.0.0.1", port) as home:
            await home.publish(topic, b"ON", qos=1, retain=True)
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(
                lambda: f"{topic} is no command to a switch, and ignored" in caplog.messages, what="it"
            )


async def test_names_of_things_are_neither_topics_nor_confused(port: int) -> None:
    names = ("a.b", "a_b", "a-b", "_.")
    async with memory_bench() as bench, overheard(port, "homeassistant/#") as heard:
        async with published(port, bench) as watcher:
            watcher.on_map(room(*(thing(name) for name in names)))
            await until(lambda: len(found(heard)) == len(names), what="announcements")
        assert {each["name"] for each in found(heard).values()} == set(names)
        for topic, payload in heard:
            assert topic.count("/") == 4
            if payload:
                assert set(json.loads(payload)["state_topic"]) <= set(
                    "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-/"
                )


async def test_bytes_of_others_below_its_announcements_are_taken_back(port: int) -> None:
    async with (
        overheard(port, "homeassistant/#") as heard,
        aiomqtt.Client("127.0.0.1", port) as other,
        memory_bench() as bench,
    ):
        topic = f"homeassistant/event/pointit_{bench.bus.site}/ghost/config"
        await other.publish(topic, b"\xff{", retain=True)
        async with published(port, bench) as watcher:
            watcher.on_map(room())
            await until(lambda: heard[-1:] == [(topic, b"")], what="the last message to be empty")


@pytest.mark.parametrize("address", ["", "http://x", "mqtt://u:secret@x", "x:70000", "mqtt://x/y", "mqtt://"])
def test_what_is_no_broker_is_one_sentence(address: str) -> None:
    with pytest.raises(ConfigError, match="--mqtt"):
        broker_of(address)


def test_the_ways_to_write_a_broker() -> None:
    assert broker_of("home").address() == ("home", 1883)
    assert broker_of("home:1884").address() == ("home", 1884)
    assert broker_of("[::1]:1884").address() == ("::1", 1884)
    secured = broker_of("mqtts://anna@home")
    assert (secured.address(), secured.tls, secured.username) == (("home", 8883), True, "anna")
