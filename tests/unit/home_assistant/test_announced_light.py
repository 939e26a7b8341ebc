"""Lights that announce themselves by MQTT discovery, as real devices do."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.home_assistant.mqtt.announced_light import AnnouncedLight, LightCommand, light_of
from pointit.bridges.home_assistant.mqtt.value_template import ValueTemplate
from pointit.runtime.errors import RefusedError
from pointit.runtime.mqtt.discovery import light_configs
from tests.support.announced_lights import (
    ESPHOME,
    ESPHOME_TOPIC,
    RELAY,
    RELAY_LIGHT,
    RELAY_TOPIC,
    TASMOTA,
    TASMOTA_STATE,
    TASMOTA_TOPIC,
    ZIGBEE,
    ZIGBEE_LIGHT,
    ZIGBEE_TOPIC,
    ZWAVE,
    ZWAVE_TOPIC,
)

PREFIX = "homeassistant"


def announced(topic: str, payload: bytes) -> AnnouncedLight:
    (config,) = light_configs(topic, payload, PREFIX)
    return light_of(config)


def light(**fields: Any) -> AnnouncedLight:
    """Return a light with the fields of an announcement, and a topic for its commands."""
    payload = json.dumps({"name": "Lamp", "unique_id": "lamp", "command_topic": "lamp/set", **fields})
    return announced("homeassistant/light/lamp/config", payload.encode())


def test_zigbee_lamp_is_switched_and_dimmed_in_its_own_scale() -> None:
    lamp = announced(ZIGBEE_TOPIC, ZIGBEE)
    assert (lamp.entity, lamp.name) == (ZIGBEE_LIGHT, "cuinaLlumTaulell")
    assert lamp.state["state"] == "unavailable"

    lamp.on_message("zigbee2mqtt/bridge/state", b'{"state":"online"}')
    assert lamp.state["state"] == "unknown"
    lamp.on_message("zigbee2mqtt/cuinaLlumTaulell", b'{"state":"ON","brightness":254,"linkquality":90}')
    assert lamp.state["state"] == "on"
    assert lamp.state["attributes"]["brightness"] == 255

    topic = "zigbee2mqtt/cuinaLlumTaulell/set"
    assert lamp.commands(is_on=False) == [LightCommand(topic, '{"state":"OFF"}')]
    assert lamp.commands(is_on=True, brightness=255) == [
        LightCommand(topic, '{"state":"ON","brightness":254}')
    ]
    assert lamp.request == LightCommand("zigbee2mqtt/cuinaLlumTaulell/get", '{"state":""}')


def test_tasmota_bulb_goes_on_by_its_last_brightness() -> None:
    lamp = announced(TASMOTA_TOPIC, TASMOTA)
    lamp.on_message("desk/tele/LWT", b"Online")
    assert lamp.commands(is_on=True) == [LightCommand("desk/cmnd/Dimmer", "100")]

    lamp.on_message("desk/tele/STATE", TASMOTA_STATE.replace(b'"Dimmer":100', b'"Dimmer":57'))
    assert (lamp.state["state"], lamp.state["attributes"]["brightness"]) == ("on", 145)
    assert lamp.commands(is_on=True) == [LightCommand("desk/cmnd/Dimmer", "57")]
    assert lamp.commands(is_on=True, brightness=145) == [LightCommand("desk/cmnd/Dimmer", "57")]
    assert lamp.commands(is_on=False) == [LightCommand("desk/cmnd/POWER", "OFF")]

    lamp.on_message("desk/tele/LWT", b"Offline")
    assert lamp.state["state"] == "unavailable"


def test_relay_without_unique_id_is_named_after_its_topic() -> None:
    lamp = announced(RELAY_TOPIC, RELAY)
    assert lamp.entity == RELAY_LIGHT
    assert lamp.topics == {"stat/NodeMCU1/RESULT", "tele/NodeMCU1/LWT"}
    lamp.on_message("tele/NodeMCU1/LWT", b"Online")
    lamp.on_message("stat/NodeMCU1/RESULT", b'{"POWER1":"ON"}')
    assert lamp.state["state"] == "on"
    lamp.on_message("stat/NodeMCU1/RESULT", b'{"POWER2":"OFF"}')
    assert lamp.state["state"] == "on", "another relay of the device"


def test_esphome_lamp_reports_effects() -> None:
    lamp = announced(ESPHOME_TOPIC, ESPHOME)
    lamp.on_message("the_tube_light/status", b"online")
    report = b'{"effect":"Rainbow","color_mode":"rgb","state":"ON","brightness":128}'
    lamp.on_message("the_tube_light/light/the_tube_light/state", report)
    assert lamp.state["attributes"] == {
        "friendly_name": "The Tube Light",
        "brightness": 128,
        "effect": "Rainbow",
    }
    assert lamp.request is None


def test_numbers_and_booleans_are_words_as_home_assistant_writes_them() -> None:
    lamp = light(
        payload_on=27, payload_off=False, state_topic="lamp", state_value_template="{{ value_json.a }}"
    )
    lamp.on_message("lamp", b'{"a":27}')
    assert lamp.state["state"] == "on"
    lamp.on_message("lamp", b'{"a":false}')
    assert lamp.state["state"] == "off"
    lamp.on_message("lamp", b'{"a":null}')
    assert lamp.state["state"] == "unknown"
    assert lamp.commands(is_on=True) == [LightCommand("lamp/set", "27")]


def test_empty_and_foreign_messages_change_nothing() -> None:
    lamp = light(state_topic="lamp")
    lamp.on_message("lamp", b"ON")
    for payload in (b"", b"on", b"\xff", b"[" * 100_000):
        lamp.on_message("lamp", payload)
        assert lamp.state["state"] == "on"


@pytest.mark.parametrize(
    ("mode", "expected"),
    [("latest", [False, True, True, False]), ("all", [False] * 4), ("any", [False, True, True, False])],
)
def test_availability_follows_its_mode(mode: str, expected: list[bool]) -> None:
    entries = [{"topic": "bridge"}, {"topic": "lamp/up", "payload_available": "yes"}]
    lamp = light(state_topic="lamp", availability=entries, availability_mode=mode)
    reports = [lamp.state["state"] != "unavailable"]
    for topic, payload in (("bridge", b"online"), ("lamp/up", b"online"), ("bridge", b"offline")):
        lamp.on_message(topic, payload)
        reports.append(lamp.state["state"] != "unavailable")
    assert reports == expected


def test_all_topics_of_availability_together_make_a_lamp_available() -> None:
    entries = [{"topic": "bridge"}, {"topic": "lamp/up"}]
    lamp = light(state_topic="lamp", availability=entries, availability_mode="all")
    lamp.on_message("bridge", b"online")
    assert lamp.state["state"] == "unavailable"
    lamp.on_message("lamp/up", b"online")
    assert lamp.state["state"] == "unknown"


def test_base_topic_stands_for_a_tilde_in_all_topics() -> None:
    fields = {"~": "house/lamp", "cmd_t": "~/set", "stat_t": "state/~", "avty": {"t": "~/up"}, "name": "Lamp"}
    lamp = announced("homeassistant/light/x/config", json.dumps(fields).encode())
    assert lamp.topics == {"state/house/lamp", "house/lamp/up"}
    assert lamp.commands(is_on=True)[0].topic == "house/lamp/set"


def test_lights_among_the_components_of_a_device_are_found() -> None:
    device = {
        "dev": {"ids": "ea334450945afc", "name": "Kitchen", "sa": "Kitchen"},
        "o": {"name": "bla2mqtt", "sw": "2.1", "url": "https://bla2mqtt.example.com/support"},
        "cmps": {
            "some_id1": {"p": "sensor", "unique_id": "temp01ae_t"},
            "some_id2": {"p": "light", "unique_id": "bulb_1", "cmd_t": "bla2mqtt/1/set"},
            "some_id3": {"p": "light", "cmd_t": "bla2mqtt/2/set", "name": "Second"},
        },
        "state_topic": "bla2mqtt/state",
    }
    payload = json.dumps(device).encode()
    configs = light_configs("homeassistant/device/0AFFD2/config", payload, PREFIX)
    lights = [light_of(config) for config in configs]
    assert [(each.name, each.area) for each in lights] == [("Kitchen", "Kitchen"), ("Second", "Kitchen")]
    assert len({each.entity for each in lights}) == 2


def test_light_without_state_topic_is_as_it_was_switched() -> None:
    lamp = light()
    assert lamp.state["state"] == "unknown"
    assert lamp.assume(is_on=True)
    assert lamp.state["state"] == "on"
    assert not light(state_topic="lamp").assume(is_on=True)


@pytest.mark.parametrize("scale", ["100", 100.0, "0100"])
def test_scale_is_read_by_its_value_as_home_assistant_converts_it(scale: object) -> None:
    lamp = light(brightness_command_topic="level", brightness_scale=scale)
    assert [each.payload for each in lamp.commands(is_on=True, brightness=255)] == ["100", "ON"]


def test_component_that_has_its_platform_alone_is_removed() -> None:
    """As the documentation of the discovery asks: https://www.home-assistant.io/integrations/mqtt."""
    device = {
        "dev": {"ids": ["02AB3C"], "name": "Shelf"},
        "o": {"name": "own"},
        "cmps": {"left": {"p": "light", "name": "Left", "cmd_t": "shelf/left"}, "right": {"p": "light"}},
    }
    configs = light_configs("homeassistant/device/02AB3C/config", json.dumps(device).encode(), PREFIX)
    assert [config.fields["name"] for config in configs] == ["Left"]


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"brightness_scale": True}, "`brightness_scale`"),
        ({"brightness_scale": "ten"}, "`brightness_scale`"),
        ({"brightness_scale": "1.5"}, "`brightness_scale`"),
        ({"brightness_scale": float("inf")}, "`brightness_scale`"),
        ({"schema": "template"}, "`schema` is template"),
        ({"schema": 3}, "`schema`"),
        ({"command_topic": "lamp/#"}, "`command_topic` that is no topic"),
        ({"command_topic": None}, "no `command_topic`"),
        ({"payload_on": {"a": 1}}, "`payload_on` that is no text"),
        (
            {"state_value_template": "{{ value | upper }}"},
            "`state_value_template` that is more than one value",
        ),
        ({"availability_topic": "up", "availability_template": "{% if 1 %}"}, "`availability`"),
        ({"availability_mode": "most"}, "`availability_mode` other than latest, all, any"),
        ({"on_command_type": "brightness"}, "brightness without a topic"),
        ({"encoding": ""}, "`encoding`"),
        ({"brightness_scale": 0}, "`brightness_scale`"),
        ({"availability_topic": "u" * 1001}, "availability `topic` of 1001 characters, limit 1000"),
        ({"availability": [{"topic": "u" * 1001}]}, "availability `topic` of 1001 characters, limit 1000"),
        ({"availability": [{"payload_available": "on"}]}, "availability `topic` that is no topic"),
        ({"availability": "lamp/up"}, "availability `topic` that is no topic"),
        ({"availability_topic": 7}, "availability `topic` that is no topic"),
        ({"availability_topic": "up", "availability": []}, "both an `availability` and an"),
        ({"command_topic": "c" * 1001}, "`command_topic` of 1001 characters, limit 1000"),
        ({"state_topic": "s/" * 201}, "`state_topic` with more than 200 slashes"),
        ({"~": "b" * 1001, "state_topic": "~/state"}, "`~` of 1001 characters, limit 1000"),
        ({"~": "b" * 600, "state_topic": "~/" + "s" * 600}, "`state_topic` of 1201 characters"),
        ({"~": 7}, "`~` that is no topic"),
        ({"retain": "often"}, "`retain` that is neither true nor false"),
        ({"optimistic": []}, "`optimistic` that is neither true nor false"),
    ],
)
def test_light_that_cannot_be_used_is_refused_by_name(fields: dict[str, Any], reason: str) -> None:
    with pytest.raises(RefusedError, match=f"Lamp cannot be used: .*{reason}"):
        light(**fields)


def test_long_topics_of_availability_are_followed() -> None:
    topic = "house/" + "u" * 900
    lamp = light(state_topic="lamp", availability_topic=topic)
    assert lamp.state["state"] == "unavailable"
    lamp.on_message(topic, b"online")
    assert lamp.state["state"] == "unknown"


@pytest.mark.parametrize("word", [True, "true", "On", 1])
def test_booleans_are_read_as_home_assistant_reads_them(word: object) -> None:
    lamp = light(state_topic="lamp", retain=word, optimistic=word)
    assert lamp.commands(is_on=True) == [LightCommand("lamp/set", "ON", retain=True)]
    assert lamp.assume(is_on=True)
    assert not light(state_topic="lamp", optimistic="off").assume(is_on=True)


def test_long_names_and_effects_are_cut_and_not_left_out() -> None:
    lamp = light(
        name="Lamp " * 100, schema="json", state_topic="lamp", device={"name": "Hub", "sa": "Attic " * 100}
    )
    assert lamp.name.startswith("Lamp Lamp")
    assert lamp.area.startswith("Attic")
    lamp.on_message("lamp", json.dumps({"state": "ON", "effect": "e" * 300}).encode())
    assert lamp.state["attributes"]["effect"] == "e" * 200, "else it would hover, which ends the effect"


@pytest.mark.parametrize("level", ["300", "-1", "bright", "null"])
def test_brightness_that_cannot_be_is_unknown_and_not_the_last_one(level: str) -> None:
    lamp = light(state_topic="lamp", brightness_command_topic="set", brightness_state_topic="level")
    json_lamp = light(schema="json", state_topic="lamp")
    lamp.on_message("lamp", b"ON")
    lamp.on_message("level", b"100")
    json_lamp.on_message("lamp", b'{"state": "ON", "brightness": 100}')
    assert lamp.state["attributes"]["brightness"] == json_lamp.state["attributes"]["brightness"] == 100

    lamp.on_message("level", level.encode())
    json_lamp.on_message("lamp", b'{"brightness": %s}' % (level if level != "bright" else '"b"').encode())
    assert "brightness" not in lamp.state["attributes"]
    assert "brightness" not in json_lamp.state["attributes"]


def test_light_whose_template_is_a_program_is_refused() -> None:
    with pytest.raises(RefusedError, match="In_wall_study_switch cannot be used"):
        announced(ZWAVE_TOPIC, ZWAVE)


@pytest.mark.parametrize(
    ("template", "payload", "value"),
    [
        (None, b"ON", "ON"),
        ("{{ value }}", b"ON", "ON"),
        ("{{value_json.POWER}}", b'{"POWER":"ON"}', "ON"),
        ("{{ value_json['state'] }}", b'{"state":"ON"}', "ON"),
        ('{{- value_json["a"].b -}}', b'{"a":{"b":1.5}}', "1.5"),
        ("{{ value_json.a }}", b"[1]", ""),
    ],
)
def test_template_takes_one_value(template: str | None, payload: bytes, value: str) -> None:
    assert ValueTemplate.parse(template).value_of(payload) == value


KEYS = (
    "schema", "cmd_t", "command_topic", "~", "dev", "name", "uniq_id", "avty", "avty_t", "stat_t", "val_tpl",
    "pl_on", "bri_scl", "bri_cmd_t", "on_cmd_type", "json", "cmps", "p", "light", "t", "availability",
)  # fmt: skip
WORDS = st.sampled_from(KEYS)
ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | WORDS | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=8),
    max_leaves=20,
)


@given(ANY_JSON, ANY_JSON)
def test_announcements_and_reports_of_any_content_raise_no_other_error(config: Any, report: Any) -> None:
    payload = json.dumps(config).encode()
    for topic in ("homeassistant/light/a/config", "homeassistant/device/a/config"):
        for announcement in light_configs(topic, payload, PREFIX):
            try:
                lamp = light_of(announcement)
            except RefusedError:
                continue
            for own in lamp.topics:
                lamp.on_message(own, json.dumps(report).encode())
            assert lamp.state["state"] in ("on", "off", "unknown", "unavailable")
            assert lamp.commands(is_on=True)


HOSTILE = [
    b'{"unique_id": "\\ud800", "command_topic": "a"}',
    b'{"name": "\\udfff", "command_topic": "a", "payload_on": "\\ud800"}',
    b'{"command_topic": "a", "device": ' + b'{"device": ' * 900 + b"1" + b"}" * 900 + b"}",
    b'{"command_topic": "a", "availability": ' + b'{"availability": ' * 900 + b"1" + b"}" * 900 + b"}",
    b'{"~": "b", "command_topic": "~", "availability": ' + b"[" * 900 + b"]" * 900 + b"}",
    b'{"command_topic": "a", "value_template": ' + b"[" * 950 + b"]" * 950 + b"}",
    b'{"command_topic": "a", "retain": ' + b"[" * 950 + b"]" * 950 + b"}",
    b"\xff\xfe{}",
]
"""Announcements of a writer who wants to stop the service."""


@pytest.mark.parametrize("payload", HOSTILE)
def test_hostile_announcement_raises_no_other_error(payload: bytes) -> None:
    for config in light_configs("homeassistant/light/lamp/config", payload, PREFIX):
        try:
            lamp = light_of(config)
        except RefusedError:
            continue
        lamp.entity.encode()
        for command in lamp.commands(is_on=True):
            command.payload.encode()


@pytest.mark.parametrize("topic", ["#", "a/+/b", "a#b", "nul\x00"])
def test_availability_on_a_filter_in_place_of_a_topic_is_refused(topic: str) -> None:
    with pytest.raises(RefusedError, match="Lamp cannot be used: it has an availability `topic` that is no"):
        light(availability=[{"topic": topic}])


def test_light_with_too_many_availability_topics_is_refused() -> None:
    with pytest.raises(RefusedError, match="has more than 20 topics of availability"):
        light(availability=[{"topic": f"gateway/{number}"} for number in range(21)])


@pytest.mark.parametrize("topic", ["$share/all//lamp", "line\nbreak", "csi\x9b", "end\uffff", "\U0001fffe"])
@pytest.mark.parametrize("key", ["command_topic", "state_topic", "brightness_state_topic"])
def test_topic_for_which_brokers_end_connections_is_refused(key: str, topic: str) -> None:
    with pytest.raises(RefusedError, match=f"it has a `{key}` that is no topic"):
        light(**{key: topic})


def test_scale_of_400_digits_is_refused() -> None:
    payload = b'{"command_topic": "a", "brightness_scale": 1' + b"0" * 400 + b"}"
    with pytest.raises(RefusedError, match="`brightness_scale` above"):
        announced("homeassistant/light/lamp/config", payload)


def test_name_with_line_breaks_is_one_line() -> None:
    lamp = light(name="Lamp\nERROR the door is open")
    assert "\n" not in lamp.name
