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
"""Keys of the words by which a light reports that it is online and offline, by parameter."""
COLOR_MODES = {"hs", "rgb", "rgbw", "rgbww", "xy"}
LONGEST_TEXT = 200
"""Names and topics that are longer are left out."""


def command(color: Rgb) -> bytes:
    """Return the command that shows `color`: its hue at full value, and a brightness. Black is off."""
    level = max(color)
    if level == 0:
        return b'{"state":"OFF"}'
    red, green, blue = (round(value * 255 / level) for value in color)
    hue = {"r": red, "g": green, "b": blue}
    brightness = max(1, round(level * FULL / 255))
    message = {"state": "ON", "brightness": brightness, "color": hue}
    return json.dumps(message, separators=(",", ":")).encode()


class AnnouncedLight(NamedTuple):
    """A light that takes commands in JSON."""

    name: str
    topic: str
    """Topic of its commands."""
    availability: str
    """Topic that reports if it is online, or `""`."""
    has_color: bool
    online: str = ""
    """Word there for online, or `""` for `ONLINE`."""
    offline: str = ""


def announcement_topics(prefix: str) -> tuple[str, ...]:
    """Return the topics of announcements, which brokers retain; `prefix` is that of Home Assistant's."""
    zigbee = tuple(f"{base}{DEVICES}" for base in ("+", "+/+", "+/+/+"))
    home_assistant = (f"{prefix}/light/#", f"{prefix}/device/#")
    return zigbee + home_assistant


def is_online(payload: bytes, online: str, offline: str) -> bool | None:
    """Return True if a message is the word `online`, False for `offline`, None for anything else.

    It is the word, or an object in JSON whose `state` is the word, as Zigbee2MQTT writes it.
    """
    text = payload.decode(errors="replace")
    state = _mapping(_parsed(payload)).get("state")
    words = {text, _text(state)}
    if online in words:
        return True
    if offline in words:
        return False
    return None


def announced_lights(topic: str, payload: object, prefix: str) -> list[AnnouncedLight]:
    """Return the lights that a message announces, whatever it holds. `prefix` is Home Assistant's."""
    # Zigbee2MQTT announces all its devices in one message
    value = _parsed(payload)
    if topic.endswith(DEVICES):
        return list(_zigbee_lights(topic.removesuffix(DEVICES), value))

    # Home Assistant's discovery: a light, or a device whose components may be lights
    if not topic.endswith("/config") or not isinstance(value, dict):
        return []
    config = cast("dict[str, Any]", value)
    if topic.startswith(f"{prefix}/light/"):
        return list(_light(config))
    if not topic.startswith(f"{prefix}/device/"):
        return []
    lights: list[AnnouncedLight] = []
    for item in _mapping(_get(config, "components")).values():
        component = _mapping(item)
        if _get(component, "platform") == "light":
            lights += _light({**config, **component})
    return lights


def _zigbee_lights(base: str, devices: object) -> Iterator[AnnouncedLight]:
    for item in _items(devices):
        device = _mapping(item)
        name = _text(device.get("friendly_name"))
        definition = _mapping(device.get("definition"))

        # A device with several lights counts as one lamp, which has colour if any of them has
        is_light = False
        features: set[str] = set()
        for exposed in map(_mapping, _items(definition.get("exposes"))):
            if exposed.get("type") == "light":
                is_light = True
                for feature in _items(exposed.get("features")):
                    features.add(_text(_mapping(feature).get("name")))
        if not name or not is_light:
            continue
        has_color = bool(features & {"color_xy", "color_hs"})
        topic = f"{base}/{name}"
        yield AnnouncedLight(name, f"{topic}/set", f"{topic}/availability", has_color)


def _light(config: Mapping[str, Any]) -> Iterator[AnnouncedLight]:
    """Yield the light of `config`, if it takes JSON."""
    topic = _topic(config, _get(config, "command_topic"))
    if config.get("schema") != "json" or not topic:
        return
    device = _mapping(_get(config, "device"))
    name = _text(config.get("name")) or _text(device.get("name")) or topic

    # Availability: by a topic of the light itself, or by the last one of a list, or of a single entry
    own_topic = _get(config, "availability_topic")
    entries = _get(config, "availability")
    listed = _items(entries) or [entries]
    entry = _mapping(listed[-1])
    availability = _topic(config, own_topic or _get(entry, "topic"))
    source = config if own_topic else entry
    online = _text(_get(source, WORDS["online"]))
    offline = _text(_get(source, WORDS["offline"]))
    modes = {_text(mode) for mode in _items(_get(config, "supported_color_modes"))}
    has_color = bool(modes & COLOR_MODES)
    yield AnnouncedLight(name, topic, availability, has_color, online, offline)


def _get(config: Mapping[str, Any], key: str) -> object:
    return config.get(key, config.get(ABBREVIATIONS[key]))


def _topic(config: Mapping[str, Any], value: object) -> str:
    """Return a topic, with `~` at its start or end as the base topic of `config`."""
    topic = _text(value)
    base = _text(config.get("~"))
    if not base:
        return topic
    if topic.startswith("~"):
        return base + topic[1:]
    if topic.endswith("~"):
        return topic[:-1] + base
    return topic


def _parsed(payload: object) -> object:
    """Return the value of a message in JSON, or None."""
    if not isinstance(payload, bytes | bytearray):
        return None
    try:
        return json.loads(payload)
    except (ValueError, RecursionError):
        return None


def _text(value: object) -> str:
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        return ""
    return value


def _mapping(value: object) -> dict[str, Any]:
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


def _items(value: object) -> list[object]:
    return cast("list[object]", value) if isinstance(value, list) else []
