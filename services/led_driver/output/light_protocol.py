"""Announcements and commands of smart lamps over MQTT, by Zigbee2MQTT and Home Assistant. Pure."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from pointit.runtime.mqtt.discovery import (
    availabilities,
    discovery_topics,
    items,
    json_value,
    light_configs,
    mapping,
    name_of,
    text,
    topic_text,
)
from pointit.schemas.base import Rgb

FULL = 254
"""Full brightness of Zigbee; Home Assistant's scale ends at 255, which Zigbee2MQTT does not take."""
DEVICES = "/bridge/devices"
"""End of the topic of Zigbee2MQTT's devices; before it is the base topic, which may have slashes."""
ONLINE = "online"
"""Word on availability topics unless a lamp or its announcement has another."""
OFFLINE = "offline"
"""The same for an absent lamp."""
WORDS = {"online": "payload_available", "offline": "payload_not_available"}
"""Keys of the words by which a light reports that it is online and offline, by parameter."""
COLOR_MODES = {"hs", "rgb", "rgbw", "rgbww", "xy"}


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


class DiscoveredLight(NamedTuple):
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
    return zigbee + discovery_topics(prefix)


def is_online(payload: bytes, online: str, offline: str) -> bool | None:
    """Return True if a message is the word `online`, False for `offline`, None for anything else.

    It is the word, or an object in JSON whose `state` is the word, as Zigbee2MQTT writes it.
    """
    state = mapping(json_value(payload)).get("state")
    words = {payload.decode(errors="replace"), text(state)}
    if online in words:
        return True
    if offline in words:
        return False
    return None


def announced_lights(topic: str, payload: object, prefix: str) -> list[DiscoveredLight]:
    """Return the lights that a message announces, whatever it holds. `prefix` is Home Assistant's."""
    # Zigbee2MQTT announces all its devices in one message
    if topic.endswith(DEVICES):
        return list(_zigbee_lights(topic.removesuffix(DEVICES), json_value(payload)))

    lights: list[DiscoveredLight] = []
    for config in light_configs(topic, payload, prefix):
        lights += _light(config.fields)
    return lights


def _zigbee_lights(base: str, devices: object) -> Iterator[DiscoveredLight]:
    for item in items(devices):
        device = mapping(item)
        name = text(device.get("friendly_name"))
        definition = mapping(device.get("definition"))

        # A device with several lights counts as one lamp, which has colour if any of them has
        is_light = False
        features: set[str] = set()
        for exposed in map(mapping, items(definition.get("exposes"))):
            if exposed.get("type") == "light":
                is_light = True
                for feature in items(exposed.get("features")):
                    features.add(text(mapping(feature).get("name")))
        if not name or not is_light:
            continue
        has_color = bool(features & {"color_xy", "color_hs"})
        topic = f"{base}/{name}"
        yield DiscoveredLight(name, f"{topic}/set", f"{topic}/availability", has_color)


def _light(config: Mapping[str, Any]) -> Iterator[DiscoveredLight]:
    """Yield the light of `config`, if it takes JSON."""
    topic = topic_text(config.get("command_topic"))
    if config.get("schema") != "json" or not topic:
        return
    name = name_of(config) or topic

    # Availability: by a topic of the light itself, or by the last one of a list
    entry: Mapping[str, Any] = {}
    for listed in availabilities(config):
        if topic_text(listed.get("topic")):
            entry = listed
    availability = topic_text(entry.get("topic"))
    online = text(entry.get(WORDS["online"]))
    offline = text(entry.get(WORDS["offline"]))
    modes = {text(mode) for mode in items(config.get("supported_color_modes"))}
    has_color = bool(modes & COLOR_MODES)
    yield DiscoveredLight(name, topic, availability, has_color, online, offline)
