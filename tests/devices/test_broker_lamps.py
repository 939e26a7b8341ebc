"""Lamps of a home without Home Assistant: on a genuine MQTT broker, by what real devices announce.

The lamps answer as the documentation of Zigbee2MQTT and Tasmota states, or are those of a library of another
project.
"""

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator, Callable
from pathlib import Path
from typing import Any

import aiomqtt
import pytest
import yaml

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.setup.home_files import HomeFiles
from pointit.runtime.clock import WallClock
from pointit.schemas import HomeSetup, SetUpHome
from pointit.schemas.topics import HEALTH, SET_UP_HOME
from tests.examples.running import running
from tests.support.announced_lights import (
    BULB,
    BULB_STATE,
    ESPHOME,
    ESPHOME_TOPIC,
    PLUG,
    RELAY,
    RELAY_LIGHT,
    RELAY_TOPIC,
    SENSOR,
    TASMOTA,
    TASMOTA_TOPIC,
    ZIGBEE,
    ZIGBEE_LIGHT,
    ZIGBEE_TOPIC,
    ZWAVE,
    ZWAVE_TOPIC,
)
from tests.support.bench import Bench, memory_bench, until
from tests.support.buses import free_port, is_listening
from tests.support.home_assistant import HomeSite, start, thing
from tests.support.mqtt import broker
from tests.support.pace import Patience

TASMOTA_LIGHT = "light.a0424b_li_1_c60c5272"
ZIGBEE_STATE = "zigbee2mqtt/cuinaLlumTaulell"


class Devices:
    """A Zigbee2MQTT with a lamp, and a Tasmota bulb and relay, on a broker."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self._client = client
        self.zigbee: dict[str, Any] = {"state": "OFF", "brightness": 120, "linkquality": 90}
        self.bulb = {"POWER": "ON", "Dimmer": 57}
        self.relay = "OFF"
        self.heard: list[tuple[str, str]] = []
        """Commands, in their order."""

    async def announce(self) -> None:
        for topic, payload in (
            (ZIGBEE_TOPIC, ZIGBEE),
            (TASMOTA_TOPIC, TASMOTA),
            (RELAY_TOPIC, RELAY),
            (ZWAVE_TOPIC, ZWAVE),
            ("zigbee2mqtt/bridge/state", b'{"state":"online"}'),
            ("desk/tele/LWT", b"Online"),
            ("tele/NodeMCU1/LWT", b"Online"),
            ("stat/NodeMCU1/RESULT", b'{"POWER1":"OFF"}'),
            ("desk/tele/STATE", json.dumps(self.bulb).encode()),
        ):
            await self._client.publish(topic, payload, qos=1, retain=True)

    async def run(self) -> None:
        """Answer commands. Zigbee2MQTT retains no states, and reports one that is asked for."""
        async for message in self._client.messages:
            assert isinstance(message.payload, bytes)
            topic, payload = message.topic.value, message.payload.decode()
            self.heard.append((topic, payload))
            if topic == f"{ZIGBEE_STATE}/set":
                self.zigbee |= json.loads(payload)
            if topic.startswith(f"{ZIGBEE_STATE}/"):
                await self._client.publish(ZIGBEE_STATE, json.dumps(self.zigbee))
            if topic == "desk/cmnd/Dimmer":
                self.bulb = {"POWER": "ON", "Dimmer": int(payload)}
            if topic == "desk/cmnd/POWER":
                self.bulb["POWER"] = payload
            if topic.startswith("desk/cmnd/"):
                await self._client.publish("desk/tele/STATE", json.dumps(self.bulb))
            if topic == "cmnd/NodeMCU1/POWER1":
                self.relay = payload
                await self._client.publish("stat/NodeMCU1/RESULT", json.dumps({"POWER1": payload}))

    def commands(self, topic: str) -> list[str]:
        return [payload for heard, payload in self.heard if heard == topic]


@contextlib.asynccontextmanager
async def devices_on(port: int, **login: Any) -> AsyncGenerator[Devices]:
    await until(lambda: is_listening(port), what="the broker")
    async with aiomqtt.Client("127.0.0.1", port, **login) as client:
        devices = Devices(client)
        filters = [f"{ZIGBEE_STATE}/set", f"{ZIGBEE_STATE}/get", "desk/cmnd/#", "cmnd/#"]
        await client.subscribe([(each, 1) for each in filters])
        await devices.announce()
        async with running(devices.run()):
            yield devices


def things() -> list[Any]:
    return [thing("zigbee", ZIGBEE_LIGHT), thing("bulb", TASMOTA_LIGHT), thing("relay", RELAY_LIGHT)]


async def test_lamps_of_three_kinds_are_switched_by_pointing(port: int) -> None:
    async with devices_on(port) as devices, memory_bench(WallClock()) as bench:
        site = HomeSite(bench, *things())
        start(bench, HomeAssistantConfig(broker=f"127.0.0.1:{port}"))
        await until(lambda: site.selected == {"bulb"}, what="the states of before")
        await until(
            lambda: site.states["zigbee"].state == "off", what="the answer of the lamp that was asked"
        )

        for name in ("zigbee", "relay"):
            site.point(name)
        site.point("bulb", on=False)
        await until(lambda: len(site.results) == 3, what="the results")
        assert {each.result for each in site.results} == {"done"}
        assert site.selected == {"zigbee", "relay"}
        assert (devices.zigbee["state"], devices.bulb["POWER"], devices.relay) == ("ON", "OFF", "ON")
        assert devices.zigbee["brightness"] == 120

        site.point("bulb")
        await until(lambda: "bulb" in site.selected, what="the bulb to be on")
        assert devices.bulb == {"POWER": "ON", "Dimmer": 57}, "by its last brightness"


async def test_lamp_brightens_while_hovered_and_is_restored(port: int) -> None:
    async with devices_on(port) as devices, memory_bench(WallClock()) as bench:
        site = HomeSite(bench, *things())
        start(bench, HomeAssistantConfig(broker=f"127.0.0.1:{port}"))
        await until(lambda: site.selected == {"bulb"}, what="the states of before")

        async with site.hovering("bulb"):
            await until(lambda: devices.bulb["Dimmer"] == 68, what="a fifth more")
        await until(lambda: devices.bulb["Dimmer"] == 57, what="the brightness of before")


async def test_lamps_that_are_gone_or_unavailable_have_a_reason(port: int) -> None:
    async with devices_on(port), memory_bench(WallClock()) as bench:
        site = HomeSite(bench, *things())
        start(bench, HomeAssistantConfig(broker=f"127.0.0.1:{port}"))
        await until(lambda: site.selected == {"bulb"}, what="the states of before")

        async with aiomqtt.Client("127.0.0.1", port) as client:
            await client.publish("desk/tele/LWT", b"Offline", retain=True)
            await client.publish(RELAY_TOPIC, b"", retain=True)
        reason = "is unavailable on the broker: switch it on at the wall"
        await until(lambda: reason in site.states["bulb"].reason, what="the bulb to be unavailable")
        reason = f"the broker has no {RELAY_LIGHT}"
        await until(lambda: reason in site.states["relay"].reason, what="the relay to be gone")


async def test_lamps_return_after_a_restart_of_the_broker(tmp_path: Path) -> None:
    unused_port = free_port()
    async with memory_bench(WallClock()) as bench:
        site = HomeSite(bench, *things())
        start(bench, HomeAssistantConfig(broker=f"127.0.0.1:{unused_port}"))
        for _ in range(2):
            with broker(tmp_path, unused_port):
                async with devices_on(unused_port):
                    await until(lambda: site.selected == {"bulb"}, what="the states")
                    site.point("bulb", on=False)
                    await until(lambda: not site.selected, what="the bulb to be off")
            await until(lambda: site.states["bulb"].state == "unavailable", what="the loss")
        assert "the broker" in site.states["bulb"].reason


async def cards_of(bench: Bench, folder: Path) -> "Cards":
    """Start the set-up of a home in `folder`, and return its cards."""
    health = bench.collect(HEALTH)
    start(bench, HomeAssistantConfig(setup=str(folder)))
    await until(lambda: bool(health), what="the service")
    return Cards(bench)


class Cards:
    """The cards of a page."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    async def act(self, act: Any = "read", **fields: Any) -> HomeSetup:
        return await self._bench.bus.call(SET_UP_HOME, SetUpHome(act=act, **fields))

    async def until(self, condition: Callable[[HomeSetup], bool]) -> HomeSetup:
        patience = Patience(30)
        setup = await self.act()
        while not condition(setup):
            assert not patience.is_over(), f"waited {patience} in vain; the cards show {setup}"
            await asyncio.sleep(0.1)
            setup = await self.act()
        return setup


async def test_cards_list_lamps_and_light_the_one_whose_turn_it_is(port: int, tmp_path: Path) -> None:
    files = HomeFiles(tmp_path)
    files.create()
    async with devices_on(port) as devices, memory_bench(WallClock()) as bench:
        cards = await cards_of(bench, tmp_path)
        await cards.act("connect", url=f"mqtt://127.0.0.1:{port}")

        setup = await cards.until(lambda setup: {lamp.state for lamp in setup.lamps} == {"on", "off"})
        assert setup.is_connected
        assert {lamp.id: (lamp.label, lamp.state) for lamp in setup.lamps} == {
            ZIGBEE_LIGHT: ("cuinaLlumTaulell", "off"),
            TASMOTA_LIGHT: ("desk", "on"),
            RELAY_LIGHT: ("NodeMCU1 1", "off"),
        }
        assert [sentence for sentence in setup.advice if "In_wall_study_switch cannot be used" in sentence]
        stored = yaml.safe_load(files.site.read_text())
        assert stored["home_assistant"] == {"broker": f"mqtt://127.0.0.1:{port}"}

        await cards.act("choose", lamps=(ZIGBEE_LIGHT, RELAY_LIGHT))
        await cards.act("hand", hand="phone", user="anna")
        setup = await cards.until(lambda _setup: devices.zigbee["state"] == "ON")
        assert (setup.target, setup.is_lit) == (ZIGBEE_LIGHT, True)
        assert devices.relay == "OFF"

        await cards.act("skip")
        await cards.until(lambda _setup: devices.relay == "ON")
        await cards.until(lambda _setup: devices.zigbee["state"] == "OFF")
        assert devices.zigbee["brightness"] == 120
        await cards.act("go", step="choose")
        await cards.until(lambda _setup: devices.relay == "OFF")


async def test_lamp_that_retains_no_state_is_lit_and_off_afterwards(port: int, tmp_path: Path) -> None:
    HomeFiles(tmp_path).create()
    async with devices_on(port) as devices, memory_bench(WallClock()) as bench:
        async with aiomqtt.Client("127.0.0.1", port) as client:
            await client.publish("stat/NodeMCU1/RESULT", b"", qos=1, retain=True)
        cards = await cards_of(bench, tmp_path)
        await cards.act("connect", url=f"mqtt://127.0.0.1:{port}")
        await cards.until(lambda setup: len(setup.lamps) == 3)
        await cards.act("choose", lamps=(RELAY_LIGHT, ZIGBEE_LIGHT))
        await cards.act("hand", hand="phone", user="anna")

        setup = await cards.until(lambda setup: setup.is_lit)
        assert (setup.target, setup.goes_off, devices.relay) == (RELAY_LIGHT, True, "ON")
        await cards.act("skip")
        await cards.until(lambda _setup: devices.relay == "OFF")
    assert devices.commands("cmnd/NodeMCU1/POWER1") == ["ON", "OFF"]


async def test_cards_log_in_at_a_broker_by_the_file_of_its_password(
    tmp_path: Path,
) -> None:
    unused_port = free_port()
    passwords = tmp_path / "passwords"
    making = await asyncio.create_subprocess_exec("mosquitto_passwd", "-b", "-c", passwords, "anna", "sesame")
    await making.wait()
    files = HomeFiles(tmp_path / "home")
    files.create()
    options = f"allow_anonymous false\npassword_file {passwords}\nuser root\n"
    with broker(tmp_path, unused_port, options):
        await until(lambda: is_listening(unused_port), what="the broker")
        async with memory_bench(WallClock()) as bench:
            cards = await cards_of(bench, tmp_path / "home")
            url = f"mqtt://anna@127.0.0.1:{unused_port}"
            await cards.act("connect", url=url)
            setup = await cards.until(lambda setup: "refuses the user name" in setup.problem)
            assert not setup.has_token

            files.password.write_text("sesame")
            files.password.chmod(0o600)
            await cards.act("connect", url=url)
            setup = await cards.until(lambda setup: setup.is_connected)
            assert setup.has_token
            assert "sesame" not in setup.model_dump_json() + files.site.read_text()


async def test_address_of_a_broker_with_a_password_is_refused_and_not_shown(tmp_path: Path) -> None:
    async with memory_bench(WallClock()) as bench:
        cards = await cards_of(bench, tmp_path)
        with pytest.raises(Exception, match="no address of a broker") as caught:
            await cards.act("connect", url="mqtt://anna:sesame@hub")
        assert "sesame" not in str(caught.value)


@pytest.mark.parametrize(
    ("messages", "sentence"),
    [
        ([], "nothing has announced itself to 127.0.0.1"),
        ([("tasmota/discovery/2462AB/config", PLUG)], "`SetOption30 1` makes its relay a light"),
        ([("homeassistant/device/0AFFD2/config", SENSOR)], "1 devices without a light have announced"),
    ],
)
async def test_card_without_lamps_says_what_has_announced_itself(
    port: int, tmp_path: Path, messages: list[tuple[str, bytes]], sentence: str
) -> None:
    HomeFiles(tmp_path).create()
    await until(lambda: is_listening(port), what="the broker")
    async with aiomqtt.Client("127.0.0.1", port) as client:
        for topic, payload in messages:
            await client.publish(topic, payload, qos=1, retain=True)
        async with memory_bench(WallClock()) as bench:
            cards = await cards_of(bench, tmp_path)
            await cards.act("connect", url=f"mqtt://127.0.0.1:{port}")
            setup = await cards.until(lambda setup: sentence in " ".join(setup.advice))
    assert not setup.lamps


async def test_lamp_that_announces_itself_when_a_home_is_online_is_found(port: int, tmp_path: Path) -> None:
    """A device with `discovery_retain: false`, as an ESPHome or a gateway can be set to."""
    HomeFiles(tmp_path).create()
    await until(lambda: is_listening(port), what="the broker")

    async def announce(client: aiomqtt.Client) -> None:
        async for message in client.messages:
            if message.payload == b"online":
                await client.publish(ESPHOME_TOPIC, ESPHOME)

    async with aiomqtt.Client("127.0.0.1", port) as client, memory_bench(WallClock()) as bench:
        await client.subscribe("homeassistant/status")
        async with running(announce(client)):
            cards = await cards_of(bench, tmp_path)
            await cards.act("connect", url=f"mqtt://127.0.0.1:{port}")
            setup = await cards.until(lambda setup: bool(setup.lamps))
    assert [lamp.label for lamp in setup.lamps] == ["The Tube Light"]


async def test_bulb_that_announces_itself_as_a_tasmota_is_switched(port: int) -> None:
    answers = {b"ON": b'{"POWER":"ON"}', b"OFF": b'{"POWER":"OFF"}', b"": BULB_STATE}

    async def answer(client: aiomqtt.Client) -> None:
        async for message in client.messages:
            assert isinstance(message.payload, bytes)
            commands.append((message.topic.value, message.payload.decode()))
            await client.publish("stat/tasmota_B94927/RESULT", answers[message.payload])

    commands: list[tuple[str, str]] = []
    await until(lambda: is_listening(port), what="the broker")
    async with aiomqtt.Client("127.0.0.1", port) as client, memory_bench(WallClock()) as bench:
        await client.publish("tasmota/discovery/00000049A3BC/config", BULB, qos=1, retain=True)
        await client.publish("tele/tasmota_B94927/LWT", b"Online", qos=1, retain=True)
        await client.subscribe("cmnd/#")
        async with running(answer(client)):
            site = HomeSite(bench, thing("bulb", "light.tasmota_00000049a3bc_1"))
            start(bench, HomeAssistantConfig(broker=f"127.0.0.1:{port}"))
            await until(lambda: site.states.get("bulb") is not None, what="the bulb")
            await until(lambda: site.states["bulb"].state == "off", what="its answer")
            site.point("bulb")
            await until(lambda: site.selected == {"bulb"}, what="the bulb to be on")
    assert ("cmnd/tasmota_B94927/POWER1", "ON") in commands
