"""Messages of smart lights, whatever a broker may deliver, and commands at rates that bulbs take."""

import asyncio
import itertools
import json
from typing import Any

import aiomqtt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.runtime.mqtt.broker_client import BrokerClient
from pointit.schemas.base import Rgb
from pointit.services.led_driver.output.lamp_commands import DARK, LampCommands
from pointit.services.led_driver.output.light_protocol import (
    DiscoveredLight,
    announced_lights,
    announcement_topics,
    command,
    is_online,
)
from pointit.services.led_driver.output.mqtt_output import MqttConfig

ZIGBEE_TOPIC = "zigbee2mqtt/bridge/devices"
ZIGBEE = """[
  {"ieee_address": "0x00", "type": "Coordinator", "friendly_name": "Coordinator", "definition": null},
  {"friendly_name": "kitchen/desk", "definition": {"model": "9290022166", "exposes": [
    {"type": "light", "features": [
      {"type": "binary", "name": "state"}, {"type": "numeric", "name": "brightness", "value_max": 254},
      {"type": "composite", "name": "color_xy", "features": [{"name": "x"}, {"name": "y"}]}]},
    {"type": "numeric", "name": "linkquality"}]}},
  {"friendly_name": "bulb", "definition": {"exposes": [{"type": "light", "features": [{"name": "state"}]}]}},
  {"friendly_name": "plug", "definition": {"exposes": [{"type": "switch", "features": [{"name": "state"}]}]}}
]"""
ESPHOME = """{"schema": "json", "brightness": true, "sup_clrm": ["rgb"], "name": "", "dev": {"name": "Strip"},
  "cmd_t": "strip/light/main/command", "avty_t": "strip/status", "uniq_id": "ESPlightmain"}"""
TASMOTA = """{"schema": "json", "name": "Spot", "cmd_t": "cmnd/spot/Json", "avty_t": "tele/spot/LWT",
  "pl_avail": "Online", "pl_not_avail": "Offline"}"""
OWN_WORDS = """{"schema": "json", "name": "Bar", "cmd_t": "bar/set",
  "avty": [{"t": "bridge"}, {"t": "bar/state", "pl_avail": "here", "pl_not_avail": "away"}]}"""
BASE = """{"~": "home/lamp", "schema": "json", "command_topic": "~/set", "name": "Lamp",
  "availability": [{"topic": "bridge"}, {"t": "~/status"}]}"""
DEVICE = """{"dev": {"name": "Panel"}, "cmps": {
  "a": {"p": "light", "schema": "json", "cmd_t": "panel/set", "supported_color_modes": ["hs"]},
  "b": {"p": "sensor", "stat_t": "panel/state"}, "c": {"p": "light", "cmd_t": "panel/plain"}}}"""
SHARED = """{"dev": {"name": "Shelf"}, "avty": {"t": "shelf/link", "pl_avail": "up"},
  "cmps": {"a": {"p": "light", "schema": "json", "cmd_t": "shelf/set", "name": null}}}"""


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        ((0, 0, 0), {"state": "OFF"}),
        ((255, 255, 255), {"state": "ON", "brightness": 254, "color": {"r": 255, "g": 255, "b": 255}}),
        ((64, 32, 0), {"state": "ON", "brightness": 64, "color": {"r": 255, "g": 128, "b": 0}}),
        ((0, 0, 1), {"state": "ON", "brightness": 1, "color": {"r": 0, "g": 0, "b": 255}}),
    ],
)
def test_command_has_a_hue_at_full_value_and_a_brightness(color: Rgb, expected: dict[str, Any]) -> None:
    assert json.loads(command(color)) == expected


@pytest.mark.parametrize(
    ("topic", "payload", "expected"),
    [
        (
            ZIGBEE_TOPIC,
            ZIGBEE,
            [
                DiscoveredLight(
                    "kitchen/desk",
                    "zigbee2mqtt/kitchen/desk/set",
                    "zigbee2mqtt/kitchen/desk/availability",
                    True,
                ),
                DiscoveredLight(
                    "bulb", "zigbee2mqtt/bulb/set", "zigbee2mqtt/bulb/availability", has_color=False
                ),
            ],
        ),
        (
            "homeassistant/light/strip/main/config",
            ESPHOME,
            [DiscoveredLight("Strip", "strip/light/main/command", "strip/status", has_color=True)],
        ),
        (
            "homeassistant/light/lamp/config",
            BASE,
            [DiscoveredLight("Lamp", "home/lamp/set", "home/lamp/status", has_color=False)],
        ),
        (
            "homeassistant/device/panel/config",
            DEVICE,
            [DiscoveredLight("Panel", "panel/set", "", has_color=True)],
        ),
        (
            "homeassistant/light/spot/config",
            TASMOTA,
            [DiscoveredLight("Spot", "cmnd/spot/Json", "tele/spot/LWT", False, "Online", "Offline")],
        ),
        (
            "homeassistant/light/bar/config",
            OWN_WORDS,
            [DiscoveredLight("Bar", "bar/set", "bar/state", False, "here", "away")],
        ),
        (
            "homeassistant/device/shelf/config",
            SHARED,
            [DiscoveredLight("Shelf", "shelf/set", "shelf/link", False, "up")],
        ),
        ("homeassistant/light/lamp/state", BASE, []),
    ],
)
def test_lights_that_take_json_are_found_in_announcements(
    topic: str, payload: str, expected: list[DiscoveredLight]
) -> None:
    assert announced_lights(topic, payload.encode(), "homeassistant") == expected
    own = topic.replace("homeassistant/", "house/ha/")
    assert announced_lights(own, payload.encode(), "house/ha") == expected
    assert topic == own or not announced_lights(own, payload.encode(), "homeassistant")


KEYS = ("schema", "cmd_t", "command_topic", "~", "dev", "device", "name", "cmps", "p", "avty", "availability")
WORDS = st.sampled_from(
    (*KEYS, "exposes", "definition", "friendly_name", "features", "type", "light", "json")
)
ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | WORDS | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=6),
    max_leaves=20,
)
ANY_TOPIC = st.sampled_from(
    (ZIGBEE_TOPIC, "homeassistant/light/a/config", "homeassistant/device/a/config", "x")
)


@given(ANY_TOPIC, ANY_JSON.map(lambda value: json.dumps(value).encode()) | st.binary(max_size=50))
def test_no_announcement_raises(topic: str, payload: bytes) -> None:
    for light in announced_lights(topic, payload, "homeassistant"):
        assert light.topic
        assert light.name
    is_online(payload, "online", "offline")


def test_topics_are_those_of_zigbee2mqtt_or_as_configured() -> None:
    config = MqttConfig(broker="hub")
    assert config.command_topic("desk") == "zigbee2mqtt/desk/set"
    assert config.availability_topics("desk") == ("zigbee2mqtt/desk/availability", "zigbee2mqtt/bridge/state")
    own = MqttConfig.model_validate(
        {"topic": "house/{lamp}/cmd", "lamps": {"a": {}, "b": {"topic": "x/set", "availability": "x/up"}}}
    )
    assert [own.command_topic(lamp_id) for lamp_id in "abc"] == ["house/a/cmd", "x/set", ""]
    assert [own.availability_topics(lamp_id) for lamp_id in "abc"] == [(), ("x/up",), ()]
    config = MqttConfig(broker="hub", base_topic="de/home/z2m")
    assert config.command_topic("hall/desk") == "de/home/z2m/hall/desk/set"
    assert config.availability_topics("hall/desk") == (
        "de/home/z2m/hall/desk/availability",
        "de/home/z2m/bridge/state",
    )


def test_search_finds_zigbee2mqtt_lights_below_a_base_topic_with_levels() -> None:
    for base in ("zigbee2mqtt", "home/zigbee2mqtt", "de/home/z2m"):
        topic = f"{base}/bridge/devices"
        assert any(aiomqtt.Topic(topic).matches(each) for each in announcement_topics("house"))
        lights = announced_lights(topic, ZIGBEE.encode(), "house")
        assert [light.topic for light in lights] == [f"{base}/kitchen/desk/set", f"{base}/bulb/set"]


FOREIGN = {
    "zigbee2mqtt 1, esphome, wled": (b"online", b"offline", {}),
    "zigbee2mqtt 2": (b'{"state":"online"}', b'{"state":"offline"}', {}),
    "tasmota": (b"Online", b"Offline", {"online": "Online", "offline": "Offline"}),
    "shelly": (b"true", b"false", {"online": "true", "offline": "false"}),
    "esp easy": (b"Connected", b"Connection Lost", {"online": "Connected", "offline": "Connection Lost"}),
    "zwave-js-ui": (
        b'{"value":true,"nodeId":4}',
        b'{"value":false,"nodeId":4}',
        {"online": '{"value":true,"nodeId":4}', "offline": '{"value":false,"nodeId":4}'},
    ),
    "tasmota state": (b'{"POWER":"ON"}', b"Offline", {"online": '{"POWER":"ON"}', "offline": "Offline"}),
    "knx gateway": (b"1", b"0", {"online": 1, "offline": 0}),
}
"""Messages for online and offline of devices, and the parameters that describe them."""


@pytest.mark.parametrize("device", FOREIGN)
def test_words_of_other_devices_are_unknown_until_parameters_describe_them(device: str) -> None:
    *messages, words = FOREIGN[device]
    plain = MqttConfig(broker="hub", availability="x")
    expected = [None, None] if words else [True, False]
    assert [plain.is_online("a", "x", each) for each in messages] == expected
    described = MqttConfig.model_validate({"broker": "hub", "availability": "x", **words})
    assert [described.is_online("a", "x", each) for each in messages] == [True, False]
    of_lamp = MqttConfig.model_validate({"broker": "hub", "lamps": {"a": {"availability": "x", **words}}})
    assert [of_lamp.is_online("a", "x", each) for each in messages] == [True, False]


def test_words_of_a_lamp_do_not_count_for_its_bridge() -> None:
    config = MqttConfig(broker="hub", online="here", offline="away")
    own, bridge = config.availability_topics("desk")
    assert config.is_online("desk", own, b"here") is True
    assert config.is_online("desk", own, b"online") is None
    assert config.is_online("desk", bridge, b'{"state":"online"}') is True


@pytest.mark.parametrize(
    "wrong",
    [
        {"online": True},
        {"lamps": {"a": {"offline": False}}},
        {"topic": "zigbee2mqtt/all/set"},
        {"lamps": {"a": {"topic": "x"}, "b": {"topic": "x"}}},
        {"lamps": {"a": {"availability": "+"}}},
        {"lamp_rate_hz": 0},
    ],
)
def test_parameters_that_cannot_work_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        MqttConfig.model_validate({"broker": "hub", **wrong})


RED: Rgb = (255, 0, 0)
GREEN: Rgb = (0, 255, 0)
LAMPS = ("a", "b", "c")


def commands(lamp_rate_hz: float = 5.0, max_rate_hz: float = 1000.0) -> LampCommands:
    made = LampCommands(lamp_rate_hz, max_rate_hz)
    made.set_lamps(LAMPS)
    return made


def drain(sender: LampCommands, now_s: float, until_s: float) -> list[tuple[float, str, Rgb]]:
    """Take all commands that are due until `until_s`, as a sender that waits as told."""
    taken: list[tuple[float, str, Rgb]] = []
    while True:
        while (command := sender.take(now_s)) is not None:
            taken.append((now_s, *command))
        wait_s = sender.wait_s(now_s)
        if wait_s is None or now_s + wait_s > until_s:
            return taken
        now_s += max(wait_s, 1e-6)  # a timer is never early


def test_all_lamps_share_a_rate_and_none_waits_for_another() -> None:
    sender = commands(lamp_rate_hz=5.0, max_rate_hz=10.0)
    got: dict[str, int] = dict.fromkeys(LAMPS, 0)
    for step in range(300):
        for lamp_id in LAMPS:
            sender.show(lamp_id, (step % 256, 1, 0))
        for _, lamp_id, _ in drain(sender, step / 100, step / 100):
            got[lamp_id] += 1
    assert 28 <= sum(got.values()) <= 31
    assert max(got.values()) - min(got.values()) <= 1


def test_lamps_that_go_off_come_first() -> None:
    sender = commands()
    sender.show("b", RED)
    assert drain(sender, 0.0, 0.0)
    sender.show("a", GREEN)
    sender.show("b", DARK)
    assert [lamp for _, lamp, _ in drain(sender, 1.0, 1.1)] == ["b", "a"]
    assert list(sender.lit) == ["a"]


def test_offline_lamp_gets_its_colour_when_it_is_back() -> None:
    sender = commands()
    sender.show("a", RED)
    assert drain(sender, 0.0, 0.0)
    sender.set_offline(["a"])
    sender.show("a", GREEN)
    sender.show("b", RED)
    assert [lamp for _, lamp, _ in drain(sender, 1.0, 2.0)] == ["b"]
    sender.show("a", RED)  # as before; the bulb may have lost it
    sender.set_offline([])
    assert drain(sender, 3.0, 3.0) == [(3.0, "a", RED)]


def test_lit_lamp_that_leaves_the_map_goes_off() -> None:
    sender = commands()
    sender.show("a", RED)
    sender.show("b", DARK)
    assert len(drain(sender, 0.0, 1.0)) == 2
    sender.set_lamps(["c"])
    assert drain(sender, 1.0, 2.0) == [(1.0, "a", DARK)]
    sender.show("a", RED)
    assert sender.wait_s(2.0) is None


def test_colours_are_all_resent_after_a_new_connection() -> None:
    sender = commands()
    sender.show("a", RED)
    sender.show("b", DARK)
    assert len(drain(sender, 0.0, 1.0)) == 2
    sender.resend()
    assert {lamp for _, lamp, _ in drain(sender, 1.0, 2.0)} == {"a", "b"}


SHOW = st.tuples(st.sampled_from((*LAMPS, "gone")), st.tuples(*[st.sampled_from((0, 9, 255))] * 3))


@given(st.lists(st.tuples(st.floats(0.0, 0.5), SHOW), max_size=60))
def test_lamps_end_with_their_newest_colours_within_the_rates(
    shows: list[tuple[float, tuple[str, Rgb]]],
) -> None:
    sender = commands(lamp_rate_hz=5.0, max_rate_hz=20.0)
    now_s = 0.0
    wanted: dict[str, Rgb] = {}
    sent: list[tuple[float, str, Rgb]] = []
    for wait_s, (lamp_id, color) in shows:
        now_s += wait_s
        sender.show(lamp_id, color)
        if lamp_id in LAMPS:
            wanted[lamp_id] = color
        sent += drain(sender, now_s, now_s)
    sent += drain(sender, now_s, now_s + 100.0)

    assert {lamp_id: color for _, lamp_id, color in sent} == wanted
    times = [at_s for at_s, _, _ in sent]
    assert all(after - before >= 0.05 - 1e-9 for before, after in itertools.pairwise(times))

    for lamp_id in LAMPS:
        own = [at_s for at_s, lamp, _ in sent if lamp == lamp_id]
        assert all(after - before >= 0.2 - 1e-9 for before, after in itertools.pairwise(own))
    assert set(sender.lit) == {lamp_id for lamp_id, color in wanted.items() if color != DARK}


async def test_cancellation_that_arrives_with_a_confirmation_is_not_lost() -> None:
    confirmation: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    call = asyncio.wait_for(confirmation, 60.0)  # noqa: TID251 - as aiomqtt does
    client = BrokerClient(aiomqtt.Client("127.0.0.1"), user="")
    publishing = asyncio.create_task(client.answer(call))
    await asyncio.sleep(0.01)
    confirmation.set_result(None)
    publishing.cancel()
    await asyncio.wait({publishing})
    assert publishing.cancelled()
