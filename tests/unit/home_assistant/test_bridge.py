"""The bridge beside a Home Assistant in memory, in virtual time: many entities, names that are spoken."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from pointit.bridges.home_assistant import service
from pointit.bridges.home_assistant.entities import entities_of
from pointit.cli.maps.home_assistant import with_things
from pointit.maps.file import parse_map_file
from pointit.maps.things import things_of
from pointit.schemas import Announced, Environment
from pointit.schemas.topics import ANNOUNCED, HEALTH, MAP
from tests.support.bench import Bench, memory_bench, stand_still, until
from tests.support.home_assistant import HomeSite, MemoryHome, config_of, reading, start, thing

COUNT = 300
LAMP = "light.desk"
LIGHTS = [f"light.lamp_{number}" for number in range(COUNT)]


@asynccontextmanager
async def bridge(
    home: MemoryHome, folder: Path, monkeypatch: pytest.MonkeyPatch, *things: Any, **parameters: Any
) -> AsyncGenerator[tuple[Bench, HomeSite, list[Any]]]:
    """Yield a bench with the bridge to `home`, its site, and the reports on its health."""
    monkeypatch.setattr(service, "connected", home.connected)
    async with memory_bench() as bench:
        health = bench.collect(HEALTH)
        site = HomeSite(bench, *things)
        start(bench, config_of(folder, 1, **parameters))
        await until(lambda: len(home.client.messages) >= 3, what="the connection")
        await asyncio.sleep(0.5)  # in virtual time: the answers
        yield bench, site, health


def large_home() -> MemoryHome:
    home = MemoryHome({entity: ("off", {"friendly_name": entity.upper()}) for entity in LIGHTS})
    home.registries = {
        "config/area_registry/list": [{"area_id": f"a{n}", "name": f"Room {n}"} for n in range(10)],
        "config/device_registry/list": [{"id": f"d{n}", "area_id": f"a{n % 10}"} for n in range(COUNT)],
        "config/entity_registry/list": [
            {"entity_id": entity, "device_id": f"d{n}"} for n, entity in enumerate(LIGHTS)
        ],
    }
    return home


async def test_three_hundred_entities_become_things_by_four_messages(tmp_path: Path) -> None:
    home = large_home()
    async with home.connected(config_of(tmp_path, 1)) as connection, reading(connection):
        entities = await entities_of(connection)
    assert len(home.client.messages) == 4, "states, areas, devices, entities"
    assert [each.area for each in entities[::30]] == [f"Room {number}" for number in range(10)]
    text, names = with_things(b"", tmp_path / "home.yaml", entities)
    assert len(names) == COUNT
    things = things_of(parse_map_file(text, tmp_path / "home.yaml"))
    assert {each.home_assistant for each in things} == set(LIGHTS)
    assert {each.mode for each in things} == {"switch"}


async def test_state_that_is_too_long_is_left_out_alone(tmp_path: Path) -> None:
    rain = {"hours": "x" * 200_000}
    home = MemoryHome({"light.a": ("on", {}), "sensor.rain": ("1", rain), LAMP: ("on", {})})
    async with home.connected(config_of(tmp_path, 1)) as connection, reading(connection):
        assert set(await connection.states()) == {"light.a", LAMP}


async def test_lamp_added_to_the_map_may_show_another_sites_hover(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = MemoryHome({LAMP: ("on", {"brightness": 120}), "light.a": ("on", {"brightness": 100})})
    home.contexts[LAMP] = home.new_context("another site")
    async with bridge(home, tmp_path, monkeypatch, thing("a", "light.a")) as (bench, site, _health):
        bench.put(MAP, Environment(stamp_ns=2, name="room", things=(thing("desk", LAMP),)))
        await asyncio.sleep(1.0)
        async with site.hovering("desk"):
            await asyncio.sleep(5.0)
        assert home.calls == []


async def test_entities_that_cannot_be_switched_are_not_offered(tmp_path: Path) -> None:
    home = MemoryHome(
        {
            "cover.roof": ("closed", {"supported_features": 48}),
            "cover.door": ("closed", {"supported_features": 11}),
            "media_player.radio": ("off", {"supported_features": 384}),
            "media_player.cast": ("off", {"supported_features": 4}),
        }
    )
    async with home.connected(config_of(tmp_path, 1)) as connection, reading(connection):
        assert {each.entity for each in await entities_of(connection)} == {"cover.door", "media_player.radio"}


async def test_three_hundred_things_act_by_one_message_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = large_home()
    things = [thing(entity.partition(".")[2], entity) for entity in LIGHTS]
    async with bridge(home, tmp_path, monkeypatch, *things) as (_bench, site, _health):
        for each in things:
            site.point(each.id)
        await until(lambda: {each["state"] for each in home.states.values()} == {"on"}, what="all lamps")
        assert len(home.client.messages) == 3 + COUNT, (
            "a subscription, the configuration and the states, then a call each"
        )
        for entity in LIGHTS:
            home.set(entity, "off")
        await until(lambda: not site.selected, what="what was switched there")
        assert len(home.client.messages) == 3 + COUNT, "no echo"


async def test_many_deleted_and_unavailable_entities_are_named_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = large_home()
    things = [thing(entity.partition(".")[2], entity) for entity in LIGHTS]
    async with bridge(home, tmp_path, monkeypatch, *things) as (_bench, _site, health):
        await until(lambda: bool(health), what="a report")
        for entity in LIGHTS[:20]:
            home.set(entity, "unavailable")
        await until(
            lambda: "light.lamp_9 of thing lamp_9 and 10 more; look into" in str(health[-1]),
            what="both figures",
        )

        home.set(LIGHTS[1], None)
        await until(
            lambda: f"{LIGHTS[1]} of thing lamp_1 (did you mean" in str(health[-1]), what="the deleted"
        )

        for entity in LIGHTS:
            home.set(entity, "on")
        await until(lambda: "in Home Assistant" not in str(health[-1]), what="all to be there again")


async def test_hover_is_one_call_and_waits_after_changes_by_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = MemoryHome({LAMP: ("on", {"brightness": 100})})
    async with bridge(home, tmp_path, monkeypatch, thing("desk", LAMP)) as (_bench, site, _health):

        def commanded() -> list[int]:
            return [data["brightness"] for _service, _entity, data in home.calls]

        async with site.hovering("desk"):
            await asyncio.sleep(10.0)
            assert commanded() == [120]
            await asyncio.sleep(10.0)
            assert commanded() == [120, 100], "it ends, however long somebody points"
        await asyncio.sleep(1.0)
        async with site.hovering("desk"):
            await asyncio.sleep(1.0)
            home.set(LAMP, "on", home.new_context("somebody"), brightness=110)
            await asyncio.sleep(1.0)
        async with site.hovering("desk"):
            await asyncio.sleep(15.0)
            assert commanded() == [120, 100, 120], "no other site's hover becomes the brightness of before"
            await asyncio.sleep(10.0)
        await asyncio.sleep(5.0)
    assert commanded() == [120, 100, 120, 132, 110]


async def test_media_player_speaks_each_persons_names_in_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = MemoryHome(
        {"media_player.kitchen": ("idle", {}), "tts.cloud": ("unavailable", {}), "tts.piper": ("unknown", {})}
    )
    parameters = {
        "speaker": "media_player.kitchen",
        "rate_hz": 2,
        "people": ["anna", "ben"],
        "language": "de",
    }
    things = [thing(name, "") for name in ("screws", "nuts", "nails", "glue")]

    def spoken() -> list[str]:
        return [data["message"] for _service, _entity, data in home.calls]

    async with bridge(home, tmp_path, monkeypatch, *things, **parameters) as (bench, _site, health):

        async def announce(name: str, user: str = "anna", label: str = "") -> None:
            bench.put(ANNOUNCED, Announced(stamp_ns=1, object_id=name, label=label or name), user)
            await asyncio.sleep(0.01)  # in virtual time: the newest message of a person replaces unread ones

        await announce("screws")
        for name in ("nuts", "nails"):
            await announce(name, "ben")
        for name in ("nuts", "nails", "glue"):
            await announce(name)
        await announce("glue", "ben")
        await asyncio.sleep(3.0)

        assert spoken() == ["screws", "glue", "glue"], "the newest of each"
        await announce("nuts", "ben")
        await announce("nails", "anna")
        await announce("", "anna")
        await announce("screws", "eve")
        await announce("police", "anna", "This is the police")
        await announce("screws", "ben", "This is the police")
        await asyncio.sleep(3.0)

        assert spoken()[3:] == ["nuts", "screws"], "no name that has ended, of nobody else, and no text"
        data = {"media_player_entity_id": "media_player.kitchen", "message": "screws", "language": "de"}
        assert home.calls[-1] == ("tts.speak", "tts.piper", data)
        await until(lambda: "'names spoken', value=5" in str(health[-1].figures), what="the count")

        home.refusal = "Piper is not running"
        await announce("nuts")
        sentence = "did not run tts.speak on tts.piper (Piper is not running): correct `speaker` or `voice`"
        await until(lambda: sentence in str(health[-1]), what="the reason")

        home.set("media_player.kitchen", "unavailable")
        await until(lambda: "media_player.kitchen that speaks;" in str(health[-1]), what="its name")
        home.set("tts.piper", "unavailable")
        await until(lambda: "nobody hears names: any text" in str(health[-1]), what="no voice left")


async def test_speaker_without_a_voice_or_with_wrong_names_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = MemoryHome({"media_player.kitchen": ("idle", {})})
    async with bridge(home, tmp_path, monkeypatch, speaker="media_player.kitchn") as (_bench, _site, health):
        sentence = "media_player.kitchn that speaks (did you mean media_player.kitchen?); correct"
        await until(lambda: sentence in str(health[-1:]), what="the player")
        sentence = "nobody hears names: any text-to-speech entity is not available; look into"
        await until(lambda: sentence in str(health[-1:]), what="the voice")


async def test_silent_home_assistant_is_reported_within_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = MemoryHome({LAMP: ("off", {})})
    answer = home._answer
    answers = asyncio.Event()

    async def answer_late(*arguments: Any) -> None:
        await answers.wait()
        await answer(*arguments)

    monkeypatch.setattr(home, "_answer", answer_late)
    monkeypatch.setattr(service, "connected", home.connected)
    async with memory_bench() as bench:
        health = bench.collect(HEALTH)
        HomeSite(bench, thing("desk", LAMP))
        start(bench, config_of(tmp_path, 1))
        await asyncio.sleep(service.FIRST_REPLY_S + 1.5)
        (problem,) = health[-1].problems
        assert (problem.code, problem.sentence) == (
            "connection",
            "http://127.0.0.1:1 accepts the token but then does not answer: restart Home Assistant",
        )

        answers.set()
        await asyncio.sleep(2.0)
        assert health[-1].problems == ()


async def test_things_wait_while_home_assistant_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = MemoryHome({"light.other": ("off", {})})
    home.registries = {"get_config": {"state": "STARTING"}}
    async with bridge(home, tmp_path, monkeypatch, thing("desk", LAMP)) as (_bench, site, health):
        assert site.states["desk"].reason == "Home Assistant is still starting: wait"
        assert site.states["desk"].is_starting
        assert "correct" not in str(health[-1].problems)
        home.registries = {"get_config": {"state": "RUNNING"}}
        home.set(LAMP, "off")
        await asyncio.sleep(2.0)
        assert (site.states["desk"].state, site.states["desk"].reason) == ("off", "")


async def test_late_act_is_not_sent_when_the_process_stood_still(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = MemoryHome({LAMP: ("on", {"brightness": 100})})
    async with bridge(home, tmp_path, monkeypatch, thing("desk", LAMP)) as (bench, site, _health):
        home.latency_s = 1.0
        site.hover("desk")
        await until(lambda: bool(home.calls), what="the call of the hover")
        site.point("desk", on=False)
        await bench.settle()
        stand_still(3.0)
        await until(lambda: bool(site.results), what="the result")
        await asyncio.sleep(10.0)
        assert site.told == "no_answer: home-assistant stood still before it was done: point again"
        assert home.states[LAMP]["state"] == "on"
        assert "light.turn_off" not in {service for service, _entity, _data in home.calls}
