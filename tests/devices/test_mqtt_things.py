"""Things of a run on a genuine MQTT broker (mosquitto), as Home Assistant would find and follow them."""

import json

import aiomqtt
import pytest
from ha_mqtt_discoverable.sensors import SwitchInfo

from pointit.bridges.mqtt_things import mqtt_things
from pointit.runtime.errors import RefusedError
from pointit.schemas import Done, SelectedObject, Selection, SetThing
from pointit.schemas.topics import ACT_RESULTS, SELECTION, SET_THING
from tests.support.bench import memory_bench, until
from tests.support.mqtt import Relay, overheard
from tests.support.mqtt_things import ROOM, TRIGGER, announced, found, point, published, room, thing, told


async def test_each_thing_is_announced_and_what_is_pointed_at_arrives(port: int) -> None:
    async with memory_bench() as bench, overheard(port, "#") as heard, published(port, bench) as watcher:
        results = bench.collect(ACT_RESULTS)
        watcher.on_map(ROOM)
        await until(lambda: len(found(heard)) == 3, what="announcements")

        screws = found(heard)["event screws"]
        seat = found(heard)["event seat"]
        radio = found(heard)["switch radio"]
        assert (screws["name"], screws["event_types"]) == ("Screws, 4 mm", ["pointed"])
        assert seat["event_types"] == ["pointed", "released"]
        assert SwitchInfo.model_validate(radio).unique_id == radio["unique_id"]
        assert len({each["unique_id"] for each in (screws, seat, radio)}) == 3

        triggers = {f"{TRIGGER}{name}" for name in ("screws_pointed", "seat_released", "radio_pressed")}
        await until(lambda: triggers <= announced(heard).keys(), what="the triggers of the device")
        assert "availability_topic" not in screws, "an event that comes back looks like one that happens"
        await until(lambda: (radio["availability_topic"], b"online") in heard, what="availability")
        assert told(heard, radio["state_topic"]) == [], "nobody knows it yet"

        bench.put(SELECTION, Selection(stamp_ns=1))
        await until(lambda: bool(told(heard, radio["state_topic"])), what="the state of the switch")
        for name in ("screws", "seat", "radio"):
            for event in ("selected", "deselected"):
                before = len(results)
                point(bench, name, event)
                await until(lambda before=before: len(results) > before, what="the result")
        chosen = SelectedObject(id="radio", user="anna", since_ns=1, confidence=0.9)
        bench.put(SELECTION, Selection(stamp_ns=2, objects=(chosen,)))
        pointed = {"event_type": "pointed", "user": "anna", "confidence": 0.9, "cause": ""}

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
        assert watcher.summary()["mqtt"] == {"events": 3, "problem": ""}
        assert [each.result for each in results] == ["done"] * 6
    await until_retained(port, radio["availability_topic"], b"offline")


async def until_retained(port: int, topic: str, payload: bytes) -> None:
    async with overheard(port, topic) as heard:
        await until(lambda: bool(heard) and heard[-1][1] == payload, what=f"{topic} to be {payload!r}")


async def test_broker_retains_that_a_killed_run_is_offline(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mqtt_things, "RETRY_S", 600.0)  # as if it did not come back
    async with (
        memory_bench() as bench,
        Relay(port).running() as relay,
        overheard(port, "#") as heard,
        published(relay.port, bench) as watcher,
    ):
        watcher.on_map(ROOM)
        await until(lambda: len(found(heard)) == 3, what="announcements")
        topic = found(heard)["switch radio"]["availability_topic"]
        await until(lambda: (topic, b"online") in heard, what="availability")
        relay.cut(is_noticed=True)
        await until(lambda: (topic, b"offline") in heard, what="the last will")
        await until_retained(port, topic, b"offline")


async def test_removed_things_announcement_is_withdrawn_even_after_a_restart(port: int) -> None:
    async with memory_bench() as bench, overheard(port, "homeassistant/#") as heard:
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: len(found(heard)) == 3, what="announcements")
            watcher.on_map(room(thing("screws", "switch"), thing("radio", "switch")))
            await until(lambda: set(found(heard)) == {"switch screws", "switch radio"}, what="the other map")
        async with published(port, bench) as watcher:
            watcher.on_map(room())
            await until(lambda: not announced(heard), what="all to be taken back")
    async with overheard(port, "homeassistant/#") as later, aiomqtt.Client("127.0.0.1", port) as client:
        await client.publish("homeassistant/last", "x", qos=1)
        await until(lambda: bool(later), what="what the broker retains, then the message")
    assert [topic for topic, _ in later] == ["homeassistant/last"]


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


async def test_retained_command_is_ignored_as_old(port: int, caplog: pytest.LogCaptureFixture) -> None:
    async with memory_bench() as bench, overheard(port, "#"):
        topic = f"pointit/{bench.bus.site}/things/radio/set"
        async with aiomqtt.Client("127.0.0.1", port) as home:
            await home.publish(topic, b"ON", qos=1, retain=True)
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: f"{topic} is retained, thus old, and ignored" in caplog.text, what="it")


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
                config = json.loads(payload)
                assert set(config.get("state_topic") or config["topic"]) <= set(
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


async def test_silent_broker_is_the_named_cause_of_a_failed_act(port: int) -> None:
    async with Relay(port).running() as relay, memory_bench() as bench:
        results = bench.collect(ACT_RESULTS)
        async with published(relay.port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: watcher.state_of(ROOM.things[0]).state == "", what="the connection")
            relay.silence()
            point(bench, "screws")
            await until(lambda: len(results) == 1, 9.0, what="the result")
    cause = f"127.0.0.1:{relay.port} did not take the event: Operation timed out"
    assert (results[0].code, results[0].text) == ("no_answer", cause)
