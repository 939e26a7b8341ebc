"""Announcements and commands of smart lamps over MQTT, by Zigbee2MQTT and Home Assistant. Pure."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, cast

from pointit.schemas.base import Rgb

FULL = 254
"""Full brightness of Zigbee; Home Assistant's scale ends at 255, which Zigbee2MQTT does not take."""
DEVICES = "/bridge/devices"
"""End of the topic of Zigbee2MQTT's devices; before it is the base topic, which may have slashes."""
ONLINE = "online"
"""Word on availability topics unless a lamp or its announcement has another."""
OFFLINE = "offline"
"""The same for an absent lamp."""
ABBREVIATIONS = {
    "availability": "avty",
    "availability_topic": "avty_t",
    "payload_available": "pl_avail",
    "payload_not_available": "pl_not_avail",
    "command_topic": "cmd_t",
    "components": "cmps",
    "device": "dev",
    "platform": "p",
    "supported_color_modes": "sup_clrm",
    "topic": "t",
}
"""Short names of keys in Home Assistant's discovery."""
WORDS = {"online": "payload_available", "offline": "payload_not_available"}
"""Keys of the words by which a light tells that it is online and offline, by parameter."""
COLOR_MODES = {"hs", "rgb", "rgbw", "rgbww", "xy"}
LONGEST_TEXT = 200
"""Names and topics that are longer are left out."""


def command(color: Rgb) -> bytes:
    """Return the command that shows `color`: its hue at full value, and a brightness. Black is off."""
    level = max(color)
    if level == 0:
        return b'{"state":"OFF"}'
    red, green, blue = (round(value * 255 / level) for value in color)
    message = {
        "state": "ON",
        "brightness": max(1, round(level * FULL / 255)),
        "color": {"r": red, "g": green, "b": blue},
    }
    return json.dumps(message, separators=(",", ":")).encode()


class AnnouncedLight(NamedTuple):
    """A light that takes commands in JSON."""

    name: str
    topic: str
    """Topic of its commands."""
    availability: str
    """Topic that tells if it is online, or `""`."""
    has_color: bool
    online: str = ""
    """Word there for online, or `""` for `ONLINE`."""
    offline: str = ""


def announcement_topics(prefix: str) -> tuple[str, ...]:
    """Return the topics of announcements, which brokers retain; `prefix` is that of Home Assistant's."""
    bases = ("+", "+/+", "+/+/+")
    return (*(f"{base}{DEVICES}" for base in bases), f"{prefix}/light/#", f"{prefix}/device/#")


def is_online(payload: bytes, online: str, offline: str) -> bool | None:
    """Return True if a message is the word `online`, False for `offline`, None for anything else.

    It is the word, or an object in JSON whose `state` is the word, as Zigbee2MQTT writes it.
    """
    text = payload.decode(errors="replace")
    words = {text, _text(_mapping(_parsed(payload)).get("state"))}
    return True if online in words else False if offline in words else None


def announced_lights(topic: str, payload: object, prefix: str) -> list[AnnouncedLight]:
    """Return the lights that a message announces, whatever it holds. `prefix` is Home Assistant's."""
    value = _parsed(payload)
    if topic.endswith(DEVICES):
        return list(_zigbee_lights(topic.removesuffix(DEVICES), value))
    if not topic.endswith("/config") or not isinstance(value, dict):
        return []
    config = cast("dict[str, Any]", value)
    if topic.startswith(f"{prefix}/light/"):
        return list(_light(config))
    if not topic.startswith(f"{prefix}/device/"):
        return []
    components = _mapping(_get(config, "components"))
    return [
        light
        for component in components.values()
        if _get(_mapping(component), "platform") == "light"
        for light in _light({**config, **_mapping(component)})
    ]


def _zigbee_lights(base: str, devices: object) -> Iterator[AnnouncedLight]:
    for device in _items(devices):
        name = _text(_mapping(device).get("friendly_name"))
        exposes = _items(_mapping(_mapping(device).get("definition")).get("exposes"))
        lights = [_mapping(each) for each in exposes if _mapping(each).get("type") == "light"]
        if not name or not lights:
            continue
        features = {
            _text(_mapping(feature).get("name"))
            for light in lights
            for feature in _items(light.get("features"))
        }
        color = bool(features & {"color_xy", "color_hs"})
        yield AnnouncedLight(name, f"{base}/{name}/set", f"{base}/{name}/availability", color)


def _light(config: Mapping[str, Any]) -> Iterator[AnnouncedLight]:
    """Yield the light of `config`, if it takes JSON."""
    topic = _topic(config, _get(config, "command_topic"))
    if config.get("schema") != "json" or not topic:
        return
    device = _mapping(_get(config, "device"))
    name = _text(config.get("name")) or _text(device.get("name")) or topic
    several = _get(config, "availability")
    listed = [_mapping(each) for each in (_items(several) or [several])]
    own = _get(config, "availability_topic")
    source = listed[-1]
    availability = _topic(config, own or _get(source, "topic"))
    words = (_text(_get(config if own else source, key)) for key in WORDS.values())
    modes = {_text(mode) for mode in _items(_get(config, "supported_color_modes"))}
    yield AnnouncedLight(name, topic, availability, bool(modes & COLOR_MODES), *words)


def _get(config: Mapping[str, Any], key: str) -> object:
    return config.get(key, config.get(ABBREVIATIONS[key]))


def _topic(config: Mapping[str, Any], value: object) -> str:
    """Return a topic, with `~` at its start or end as the base topic of `config`."""
    topic = _text(value)
    base = _text(config.get("~"))
    if base and topic.startswith("~"):
        return base + topic[1:]
    return topic[:-1] + base if base and topic.endswith("~") else topic


def _parsed(payload: object) -> object:
    """Return the value of a message in JSON, or None."""
    if not isinstance(payload, bytes | bytearray):
        return None
    try:
        return json.loads(payload)
    except (ValueError, RecursionError):
        return None


def _text(value: object) -> str:
    return value if isinstance(value, str) and len(value) <= LONGEST_TEXT else ""


def _mapping(value: object) -> dict[str, Any]:
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


def _items(value: object) -> list[object]:
    return cast("list[object]", value) if isinstance(value, list) else []
