"""Messages of smart lights: commands by the documented schema, and whatever a broker may deliver."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.schemas.base import Rgb
from pointit.services.led_driver.output.mqtt.light_protocol import (
    TOPICS,
    AnnouncedLight,
    announced_lights,
    availability,
    command,
)
from pointit.services.led_driver.output.mqtt.mqtt_config import MqttConfig

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
BASE = """{"~": "home/lamp", "schema": "json", "command_topic": "~/set", "name": "Lamp",
  "availability": [{"topic": "bridge"}, {"t": "~/status"}]}"""
DEVICE = """{"dev": {"name": "Panel"}, "cmps": {
  "a": {"p": "light", "schema": "json", "cmd_t": "panel/set", "supported_color_modes": ["hs"]},
  "b": {"p": "sensor", "stat_t": "panel/state"}, "c": {"p": "light", "cmd_t": "panel/plain"}}}"""


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        ((0, 0, 0), {"state": "OFF"}),
        ((255, 255, 255), {"state": "ON", "brightness": 254, "color": {"r": 255, "g": 255, "b": 255}}),
        ((64, 32, 0), {"state": "ON", "brightness": 64, "color": {"r": 255, "g": 128, "b": 0}}),
        ((0, 0, 1), {"state": "ON", "brightness": 1, "color": {"r": 0, "g": 0, "b": 255}}),
    ],
)
def test_a_colour_is_a_hue_at_full_value_and_a_brightness(color: Rgb, expected: dict[str, Any]) -> None:
    assert json.loads(command(color)) == expected


@given(st.tuples(*[st.integers(0, 255)] * 3).filter(any))
def test_hue_times_brightness_is_the_colour(color: Rgb) -> None:
    message = json.loads(command(color))
    assert 1 <= message["brightness"] <= 254
    shown = [message["color"][key] * message["brightness"] / 254 for key in "rgb"]
    assert shown == pytest.approx(color, abs=1.1)


@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        (b"online", True),
        (b"offline", False),
        (b'{"state":"online"}', True),
        (b'{"state": "offline", "since": 1}', False),
        (b'"offline"', False),
        (b"", None),
        (b"[]", None),
        (b'{"state": {}}', None),
        (b"ON", None),
        (b"\xff", None),
        (b"[" * 100_000, None),
        (None, None),
        (1, None),
    ],
)
def test_availability_is_read_in_both_forms_and_nothing_else(payload: object, expected: object) -> None:
    assert availability(payload) is expected


@pytest.mark.parametrize(
    ("topic", "payload", "expected"),
    [
        (
            TOPICS[0],
            ZIGBEE,
            [
                AnnouncedLight(
                    "kitchen/desk",
                    "zigbee2mqtt/kitchen/desk/set",
                    "zigbee2mqtt/kitchen/desk/availability",
                    True,
                ),
                AnnouncedLight(
                    "bulb", "zigbee2mqtt/bulb/set", "zigbee2mqtt/bulb/availability", has_color=False
                ),
            ],
        ),
        (
            "homeassistant/light/strip/main/config",
            ESPHOME,
            [AnnouncedLight("Strip", "strip/light/main/command", "strip/status", has_color=True)],
        ),
        (
            "homeassistant/light/lamp/config",
            BASE,
            [AnnouncedLight("Lamp", "home/lamp/set", "home/lamp/status", has_color=False)],
        ),
        (
            "homeassistant/device/panel/config",
            DEVICE,
            [AnnouncedLight("Panel", "panel/set", "", has_color=True)],
        ),
        ("homeassistant/light/lamp/state", BASE, []),
        ("homeassistant/light/lamp/config", "", []),
    ],
)
def test_lights_that_take_json_are_found_in_announcements(
    topic: str, payload: str, expected: list[AnnouncedLight]
) -> None:
    assert announced_lights(topic, payload.encode()) == expected


KEYS = ("schema", "cmd_t", "command_topic", "~", "dev", "device", "name", "cmps", "p", "avty", "availability")
WORDS = st.sampled_from(
    (*KEYS, "exposes", "definition", "friendly_name", "features", "type", "light", "json")
)
ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | WORDS | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=6),
    max_leaves=20,
)
ANY_TOPIC = st.sampled_from((TOPICS[0], "homeassistant/light/a/config", "homeassistant/device/a/config", "x"))


@given(ANY_TOPIC, ANY_JSON.map(lambda value: json.dumps(value).encode()) | st.binary(max_size=50))
def test_no_announcement_raises(topic: str, payload: bytes) -> None:
    for light in announced_lights(topic, payload):
        assert light.topic
        assert light.name
    availability(payload)


def test_topics_are_those_of_zigbee2mqtt_or_as_configured() -> None:
    config = MqttConfig(broker="hub:1884")
    assert config.address() == ("hub", 1884)
    assert MqttConfig(broker="hub", tls=True).address() == ("hub", 8883)
    assert config.command_topic("desk") == "zigbee2mqtt/desk/set"
    assert config.availability_topics("desk") == ("zigbee2mqtt/desk/availability", "zigbee2mqtt/bridge/state")
    own = MqttConfig.model_validate(
        {"topic": "house/{lamp}/cmd", "lamps": {"a": {}, "b": {"topic": "x/set", "availability": "x/up"}}}
    )
    assert [own.command_topic(lamp_id) for lamp_id in "abc"] == ["house/a/cmd", "x/set", ""]
    assert [own.availability_topics(lamp_id) for lamp_id in "abc"] == [(), ("x/up",), ()]


@pytest.mark.parametrize(
    "wrong",
    [
        {"broker": "http://hub"},
        {"broker": "hub:port"},
        {"broker": ":1883"},
        {"topic": "zigbee2mqtt/all/set"},
        {"topic": "zigbee2mqtt/#/{lamp}"},
        {"lamps": {"a": {"topic": "x"}, "b": {"topic": "x"}}},
        {"lamps": {"a": {"availability": "+"}}},
        {"lamp_rate_hz": 0},
    ],
)
def test_parameters_that_cannot_work_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        MqttConfig.model_validate({"broker": "hub", **wrong})
