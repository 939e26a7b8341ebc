"""Lamps on a genuine MQTT broker (mosquitto), with lights of another project's library for Home Assistant."""

import asyncio
import contextlib
import json
import re
import sys
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import aiomqtt
import pytest
from ha_mqtt_discoverable import Settings
from ha_mqtt_discoverable.sensors import Light, LightInfo

import pointit
from pointit.runtime.mqtt.broker import connected
from pointit.runtime.mqtt.broker_client import BrokerClient
from pointit.schemas import Lamp
from pointit.services.led_driver.output import mqtt_output
from pointit.services.led_driver.output.mqtt_output import MqttConfig, MqttLamps, find_lamps_on
from pointit.services.led_driver.output.pixel_output import OutputHealth
from pointit.testing.trial import TrialHealth
from tests.examples.running import running
from tests.support.bench import until
from tests.support.buses import free_port, is_listening
from tests.support.mqtt import Relay, broker, overheard
from tests.support.pace import Patience

PATIENCE_S = 60.0
NAMES = ("led_0", "led_1", "led_2", "led_3")
LAMPS = tuple(Lamp(id=name, position_m=(0.0, 0.0, 1.0)) for name in ("desk", "door"))
OFF = b'{"state":"OFF"}'
RED = (255, 0, 0)
GREEN = (0, 255, 0)


@contextlib.asynccontextmanager
async def lamps_on(port: int, **parameters: object) -> AsyncGenerator[tuple[MqttLamps, TrialHealth]]:
    """Yield a running output, and its health."""
    config = MqttConfig.model_validate({"broker": f"127.0.0.1:{port}", **parameters})
    health = TrialHealth()
    output = MqttLamps(config, OutputHealth(health, config.broker))
    output.set_lamps(LAMPS)
    async with running(output.run()):
        yield output, health


class HomeLight:
    """A smart light of `ha-mqtt-discoverable`, and the states that its owner has put it in."""

    def __init__(self, port: int, name: str) -> None:
        self.states: list[dict[str, Any]] = []
        info = LightInfo(name=name, brightness=True, color_mode=True, supported_color_modes=["rgb"])
        mqtt = Settings.MQTT(host="127.0.0.1", port=port)
        settings = Settings[LightInfo](mqtt=mqtt, entity=info, manual_availability=True)
        make: Any = Light  # a library without types
        self._light = make(settings, self._on_command)
        self._light.write_config()
        self._light.set_availability(True)

    def _on_command(self, _client: object, _user: object, message: Any) -> None:
        state = json.loads(message.payload)
        if state["state"] == "OFF":
            self._light.off()
        else:
            self._light.color("rgb", state["color"])
            self._light.brightness(state["brightness"])
        self.states.append(state)

    def close(self) -> None:
        self._light.mqtt_client.disconnect()
        self._light.mqtt_client.loop_stop()


async def test_a_person_localizes_by_the_lamps_of_a_smart_home(port: int) -> None:
    async with overheard(port, "hmd/light/+/command") as commands:
        lights = {name: HomeLight(port, name) for name in NAMES}
        try:
            patience, topics, broker = Patience(PATIENCE_S), dict[str, Any](), ""
            while topics.keys() != lights.keys():
                assert not patience.is_over(), topics
                found = await find_lamps_on("127.0.0.1", port, 0.5)
                topics = {str(each.details.get("name")): each.details for each in found}
                broker = found[0].address if found else ""
            output = {
                "kind": "mqtt",
                "broker": broker,
                "lamps": {
                    name: {key: topics[name][key] for key in ("topic", "availability")} for name in NAMES
                },
            }
            settings = {"led-driver.outputs": [output], "localizer.hold_s": 0.4, "localizer.targets": 3}
            async with pointit.run("scenario_2", localize=True, settings=settings) as site:
                async with asyncio.timeout(PATIENCE_S):
                    async for pose in site.poses():
                        if pose.method == "static_targets":
                            break
            end = [{"state": "OFF"}]
            await until(
                lambda: all(light.states[-1:] in ([], end) for light in lights.values()), what="dark lamps"
            )
        finally:
            for light in lights.values():
                light.close()
    lit: set[str] = set()
    for topic, payload in commands:
        if json.loads(payload) == {"state": "OFF"}:
            lit.discard(topic)
        else:
            lit.add(topic)
        assert len(lit) <= 1, "a lamp to point at is lit alone"
    white = {"state": "ON", "brightness": 254, "color": {"r": 255, "g": 255, "b": 255}}

    assert sum(white in light.states for light in lights.values()) >= 3


async def test_lamps_follow_their_newest_colour_and_end_dark(port: int) -> None:
    async with overheard(port, "#") as heard:
        async with lamps_on(port) as (output, _health):
            for color in (RED, GREEN, (0, 127, 0)):
                output.show_lamp("desk", color)
            output.show_lamp("cellar", RED)  # is not in the map
            await until(lambda: len(heard) >= 2, what="a command")
            output.show_lamp("desk", RED)
            output.show_lamp("door", (0, 0, 0))
            await until(lambda: len(heard) >= 4, what="two more")
        await until(lambda: len(heard) >= 6, what="the end")
    desk = "zigbee2mqtt/desk/set"
    door = "zigbee2mqtt/door/set"

    assert heard[0] == ("pointit/status", b"online")
    assert heard[1] == (desk, b'{"state":"ON","brightness":127,"color":{"r":0,"g":255,"b":0}}')
    assert sorted(heard[2:4]) == [
        (desk, b'{"state":"ON","brightness":254,"color":{"r":255,"g":0,"b":0}}'),
        (door, b'{"state":"OFF"}'),
    ]
    assert heard[4:] == [(desk, b'{"state":"OFF"}'), ("pointit/status", b"offline")]


async def test_offline_lamp_is_reported_and_gets_its_colour_when_back(port: int) -> None:
    async with overheard(port, "zigbee2mqtt/+/set") as heard, aiomqtt.Client("127.0.0.1", port) as bridge:
        await bridge.publish("zigbee2mqtt/desk/availability", '{"state":"offline"}', qos=1, retain=True)
        async with lamps_on(port) as (output, health):
            topic = f"lamps 127.0.0.1:{port}"
            await until(lambda: topic in health.warnings, what="a warning")
            assert health.warnings[topic].endswith(
                "offline: desk; switch them on at the wall, or look into their bridge"
            )

            output.show_lamp("desk", RED)
            output.show_lamp("door", GREEN)
            await until(lambda: len(heard) >= 1, what="a command")

            await bridge.publish("zigbee2mqtt/desk/availability", "online", qos=1, retain=True)
            await until(lambda: len(heard) >= 2, what="the lamp that is back")
            assert [each for each, _ in heard] == ["zigbee2mqtt/door/set", "zigbee2mqtt/desk/set"]
            assert health.warnings == {}

            await bridge.publish("zigbee2mqtt/bridge/state", '{"state":"offline"}', qos=1)
            await until(lambda: "offline: desk, door;" in health.warnings.get(topic, ""), what="both")


async def test_availability_in_other_makers_words_is_described_or_named(port: int) -> None:
    """A Tasmota lamp, and one whose hub sends words of its own."""
    tasmota = {"online": "Online", "offline": "Offline"}
    lamps = {"desk": {"availability": "tele/desk/LWT", **tasmota}, "door": {"availability": "hub/link"}}
    async with overheard(port, "zigbee2mqtt/+/set") as heard, aiomqtt.Client("127.0.0.1", port) as bridge:
        await bridge.publish("tele/desk/LWT", "Offline", qos=1, retain=True)
        await bridge.publish("hub/link", '{"link": "weak"}', qos=1, retain=True)
        async with lamps_on(port, lamps=lamps) as (output, health):
            names = [f"{each} 127.0.0.1:{port}" for each in ("lamps", "availability")]
            await until(lambda: all(name in health.warnings for name in names), what="both warnings")
            assert "offline: desk;" in health.warnings[names[0]]
            assert "hub/link reports" in health.warnings[names[1]]
            assert "`online` and `offline`" in health.warnings[names[1]]

            output.show_lamp("desk", RED)
            output.show_lamp("door", GREEN)
            await until(lambda: len(heard) >= 1, what="the lamp of which nothing is known")

            await bridge.publish("tele/desk/LWT", "Online", qos=1, retain=True)
            await until(lambda: len(heard) >= 2, what="the lamp that is back")
            assert [topic for topic, _ in heard] == ["zigbee2mqtt/door/set", "zigbee2mqtt/desk/set"]

            await bridge.publish("hub/link", "", qos=1, retain=True)
            await until(lambda: not health.warnings, what="a topic without a message to be no problem")
    words = {"online": '{"link": "strong"}', "offline": '{"link": "weak"}'}
    async with aiomqtt.Client("127.0.0.1", port) as bridge:
        await bridge.publish("hub/link", words["offline"], qos=1, retain=True)
        async with lamps_on(port, lamps={"door": {**lamps["door"], **words}}) as (_output, health):
            await until(lambda: "offline: door;" in str(health.warnings), what="own words")
            await bridge.publish("hub/link", words["online"], qos=1, retain=True)
            await until(lambda: not health.warnings, what="the lamp to be back")


async def test_the_state_is_found_in_a_long_message(port: int) -> None:
    await until(lambda: is_listening(port), what="the broker")
    message = json.dumps({"networks": ["x" * 2000], "state": "offline"})
    async with lamps_on(port) as (_output, health), aiomqtt.Client("127.0.0.1", port) as hub:
        await hub.publish("zigbee2mqtt/desk/availability", message, qos=1, retain=True)
        await until(lambda: "offline: desk;" in str(health.warnings), what="the lamp")


async def test_a_broker_that_comes_late_or_restarts_gets_all_colours(tmp_path: Path) -> None:
    port = free_port()
    async with lamps_on(port) as (output, health):
        output.show_lamp("desk", RED)
        output.show_lamp("door", GREEN)
        for _ in range(2):
            await until(lambda: "cannot be reached" in str(health.warnings), what="a warning")
            with broker(tmp_path, port):
                async with overheard(port, "zigbee2mqtt/+/set") as heard:
                    await until(lambda: len(heard) >= 2, what="both lamps")
                assert health.warnings == {}
            assert {topic for topic, _ in heard} == {"zigbee2mqtt/desk/set", "zigbee2mqtt/door/set"}


async def test_the_last_will_tells_that_the_lamps_are_left_alone(port: int) -> None:
    """An automation of the smart home can react."""
    async with (
        Relay(port).running() as relay,
        overheard(port, "pointit/status") as heard,
        lamps_on(relay.port),
    ):
        await until(lambda: [payload for _, payload in heard] == [b"online"], what="the beginning")
        relay.cut(is_noticed=True)
        await until(lambda: [payload for _, payload in heard[1:2]] == [b"offline"], what="the last will")
        await until(lambda: heard[-1][1] == b"online", what="the next connection")


async def test_a_broker_without_room_for_last_wills_is_said(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def connected_once(options: dict[str, Any]) -> contextlib.AbstractAsyncContextManager[BrokerClient]:
        if not options["identifier"].endswith("-0"):
            raise ConnectionRefusedError("no room")
        return connected(options)

    monkeypatch.setattr(mqtt_output, "connected", connected_once)
    async with lamps_on(port) as (_output, health):
        sentence = r"no room, at the last will of d\w+; `last_wills: false` needs none"
        await until(lambda: bool(re.search(sentence, str(health.warnings))), what="the warning")
    async with lamps_on(port, last_wills=False) as (output, health), overheard(port, "+/desk/set") as heard:
        output.show_lamp("desk", RED)
        await until(lambda: bool(heard), what="a command")
        assert not health.warnings


async def test_a_run_that_is_killed_leaves_no_lamp_lit(port: int) -> None:
    arguments = ["run", "scenario_1", "--output", f"mqtt:127.0.0.1:{port}", "--no-view", "--no-web"]
    shown: dict[str, Any] = {}
    async with overheard(port, "zigbee2mqtt/+/set") as heard:

        def lit() -> list[str]:
            shown.update(heard)
            return [topic for topic, payload in shown.items() if payload != OFF]

        run = await asyncio.create_subprocess_exec(sys.executable, "-m", "pointit", *arguments)
        try:
            await until(lambda: len(lit()) >= 2, what="lit lamps")
        finally:
            run.kill()
            await run.wait()
        await until(lambda: not lit(), what="dark lamps")


async def test_lamp_lit_after_a_loss_is_not_darkened_by_wills(
    port: int,
) -> None:
    """The broker still has the connections of before when those of after come."""
    async with (
        Relay(port).running() as relay,
        overheard(port, "#") as heard,
        lamps_on(relay.port) as (output, _health),
    ):
        output.show_lamp("desk", RED)
        await until(lambda: len(heard) >= 2, what="a command")
        lit = heard[-1]
        relay.cut(is_noticed=False)
        await until(lambda: heard.count(lit) >= 2, what="the command again")
        wills = {("pointit/status", b"offline"), *((f"zigbee2mqtt/{each.id}/set", OFF) for each in LAMPS)}
        assert wills <= {*heard[: -1 - heard[::-1].index(lit)]}, "they would come later"


async def test_broker_gets_its_password_from_the_environment_or_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    users = tmp_path / "users"
    secret = tmp_path / "secret"
    users.write_text("anna:sesame\n", encoding="utf-8")
    users.chmod(0o600)
    hashed = await asyncio.create_subprocess_exec("mosquitto_passwd", "-U", str(users))
    assert await hashed.wait() == 0

    secret.write_text("sesame\n", encoding="utf-8")
    secret.chmod(0o600)
    options = f"allow_anonymous false\npassword_file {users}\nuser root\n"
    with broker(tmp_path, options=options) as port:
        await until(lambda: is_listening(port), what="the broker")
        (found,) = await find_lamps_on("127.0.0.1", port, 10.0)
        assert found.label == "MQTT broker that asks for a user name"

        async with lamps_on(port) as (_output, health):
            await until(lambda: "set `username` and MQTT_PASSWORD" in str(health.warnings), what="a refusal")
        monkeypatch.setenv("MQTT_PASSWORD", "open")
        async with lamps_on(port, username="anna") as (_output, health):
            await until(lambda: "correct `username` and" in str(health.warnings), what="another refusal")
        async with (
            overheard(port, "pointit/status", username="anna", password=secret.read_text().strip()) as heard,
            lamps_on(port, username="anna", password_file=str(secret)),
        ):
            await until(lambda: heard == [("pointit/status", b"online")], what="a connection")
