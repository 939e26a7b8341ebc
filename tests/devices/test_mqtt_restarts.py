"""Things at a genuine broker (mosquitto) after restarts of it, PointIt, its selector and Home Assistant."""

import contextlib
from collections.abc import AsyncGenerator
from pathlib import Path

import aiomqtt
import pytest

from pointit.bridges.mqtt_things import mqtt_things
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import RefusedError
from pointit.schemas import Selection, SetThing, ThingState, ThingStates
from pointit.schemas.selection import REPORTED
from pointit.schemas.topics import (
    ACT_RESULTS,
    CARRIER_ALIVE,
    OBJECTS,
    SELECTION,
    SELECTION_EVENTS,
    SET_THING,
    THING_STATES,
)
from pointit.services.pui.tracked_objects import TRACKER, listing
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.service import Selector
from tests.support.bench import Bench, memory_bench, until
from tests.support.buses import free_port
from tests.support.mqtt import broker, overheard
from tests.support.mqtt_things import ROOM, Heard, found, point, published, room, state_topic, thing, told


@contextlib.asynccontextmanager
async def selecting() -> AsyncGenerator[Bench]:
    """Yield a site with a selector, which knows nothing of earlier ones, in the room `ROOM`."""
    clock = WallClock()
    async with memory_bench(clock) as bench:
        selector = bench.start(Selector, SelectorConfig.model_validate({"journal": {"enabled": False}}))
        await bench.settle()
        bench.put(OBJECTS, listing(ROOM, clock.now_ns()), TRACKER)
        yield bench
        await bench.end(selector)


async def switch(bench: Bench, user: str = "anna", *, on: bool = True) -> str:
    """Switch the radio as `user`. Return what they are told."""
    return (await bench.bus.call(SET_THING, SetThing(thing="radio", on=on), user)).message


@contextlib.asynccontextmanager
async def after_a_run(port: int) -> AsyncGenerator[Heard]:
    """Let a run leave its things, the radio switched on. Yield what the broker gets afterwards."""
    async with selecting() as bench, overheard(port, "#") as heard:
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: bool(told(heard, state_topic(bench))), what="the state")
            await switch(bench)
            await until(lambda: "ON" in str(told(heard, state_topic(bench))), what="the switch to be on")
        await until(lambda: heard[-1][1] == b"offline", what="the end")
    topic = state_topic(bench)
    async with overheard(port, "#") as heard:
        await until(lambda: bool(told(heard, topic)), what="the retained state")
        heard.clear()
        yield heard


def switched(heard: Heard, bench: Bench) -> list[str]:
    return [each["state"] for each in told(heard, state_topic(bench))]


async def test_a_restart_switches_nothing_off_and_nothing_reacts_to_it(port: int) -> None:
    """A selector without a journal begins with nothing selected; the broker has retained what was on."""
    async with after_a_run(port) as heard, selecting() as bench:
        events = bench.collect(SELECTION_EVENTS)
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: bool(switched(heard, bench)), what="the state")
            assert [(each.event, each.user, each.reason) for each in events] == [
                ("selected", "mqtt", REPORTED)
            ]

            for user, on in (("ben", False), ("cleo", True), ("anna", False)):
                await switch(bench, user, on=on)
                state = "ON" if on else "OFF"
                await until(lambda state=state: switched(heard, bench)[-1] == state, what="the next state")
            assert all(each.carriers == ("mqtt",) for each in events[1:])
        assert switched(heard, bench) == ["ON", "OFF", "ON", "OFF"]


async def test_beside_a_site_that_runs_nothing_is_on_again(port: int) -> None:
    async with after_a_run(port) as heard, selecting() as bench:
        events = bench.collect(SELECTION_EVENTS)
        async with published(port, bench, is_new_run=False) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: bool(switched(heard, bench)), what="the state")
        assert (switched(heard, bench), list(events)) == (["OFF"], [])


async def test_restored_selection_is_not_reported_as_a_targets_state(port: int) -> None:
    async with after_a_run(port) as heard, selecting() as bench:
        await switch(bench)
        states = bench.collect(THING_STATES)
        async with published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: bool(switched(heard, bench)), what="the state")
            assert "on" not in {each.state for told in states for each in told.things}
        assert switched(heard, bench) == ["ON"]


async def test_switch_kept_off_by_another_target_is_shown_as_off(
    port: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(mqtt_things, "RESTORE_TIMEOUT_S", 0.1)
    async with after_a_run(port) as heard, selecting() as bench:
        off = ThingState(id="radio", state="off")
        bench.put(THING_STATES, ThingStates(stamp_ns=bench.clock.now_ns(), things=(off,)), "home")
        with contextlib.closing(bench.bus.announce(CARRIER_ALIVE, "home")):
            async with published(port, bench) as watcher:
                watcher.on_map(ROOM)
                await until(lambda: bool(switched(heard, bench)), what="the state")
        assert switched(heard, bench) == ["OFF"]
        assert [text for text in caplog.messages if text.startswith("radio was on before the restart")]


async def test_home_assistant_command_has_precedence_over_the_state_before(port: int) -> None:
    async with after_a_run(port) as heard, memory_bench() as bench:  # no selector switches it on again
        states = bench.collect(THING_STATES)
        async with published(port, bench) as watcher, aiomqtt.Client("127.0.0.1", port) as home:
            watcher.on_map(ROOM)
            bench.put(SELECTION, Selection(stamp_ns=1))
            await until(lambda: "on" in str(states[-1:]), what="the state")
            await home.publish(f"{state_topic(bench)}/set", b"OFF")
            await until(lambda: bool(switched(heard, bench)), what="the state")
        assert switched(heard, bench) == ["OFF"]


async def test_act_without_a_broker_is_refused_and_never_sent_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mqtt_things, "RETRY_S", 0.1)
    port = free_port()
    async with selecting() as bench, published(port, bench) as watcher:
        states = bench.collect(THING_STATES)

        def problems() -> set[str]:
            return {each.reason for told in states[-1:] for each in told.things}

        watcher.on_map(ROOM)
        await until(lambda: "cannot be reached" in str(problems()), what="the problem")
        for user in ("anna", "ben", "cleo"):
            with pytest.raises(RefusedError, match=f"127.0.0.1:{port}: the broker cannot be reached"):
                await switch(bench, user)

        with broker(tmp_path, port):
            async with overheard(port, "#") as heard:
                await until(lambda: problems() == {""}, what="the broker to be there")
                assert await switch(bench, "ben") == "radio selected"
                topic = state_topic(bench)
                await until(lambda: "ben" in str(told(heard, topic)), what="the state")
                assert [each["user"] for each in told(heard, topic)] == ["", "ben"]
        await until(lambda: problems() != {""}, what="the loss of the broker")

        point(bench, "screws")
        results = bench.collect(ACT_RESULTS)
        await until(lambda: bool(results), what="the result")
        assert (results[0].result, results[0].code) == ("failed", "unavailable")

        with broker(tmp_path, port):
            async with overheard(port, "#") as heard:
                await until(lambda: len(found(heard)) == 3, what="announcements to a broker that forgot them")
                await until(lambda: "ben" in str(told(heard, topic)), what="the state of the switch")
                assert told(heard, found(heard)["event screws"]["state_topic"]) == []


async def test_home_assistant_gets_all_again_when_it_has_started(port: int) -> None:
    """A device that was deleted there is announced again."""
    async with (
        selecting() as bench,
        overheard(port, "#") as heard,
        published(port, bench) as watcher,
        aiomqtt.Client("127.0.0.1", port) as home,
    ):
        watcher.on_map(ROOM)
        await until(lambda: bool(told(heard, state_topic(bench))), what="the broker")
        await switch(bench)
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


async def test_state_of_a_switch_that_is_gone_is_taken_back(port: int) -> None:
    """It is retained, and would be the first event of a button of that name."""
    async with after_a_run(port) as heard, memory_bench() as bench, published(port, bench) as watcher:
        watcher.on_map(room(thing("radio")))
        await until(lambda: (state_topic(bench), b"") in heard, what="the state")
