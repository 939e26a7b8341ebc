"""A light that announces itself by MQTT discovery: its commands, and what it reports. Pure.

https://www.home-assistant.io/integrations/light.mqtt, schemas `default` and `json`. Its state has the form of
those of Home Assistant. What cannot be carried out as it is announced is refused by name, never guessed.
"""

import contextlib
import json
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from pointit.bridges.home_assistant.home_action import UNAVAILABLE
from pointit.bridges.home_assistant.mqtt.value_template import NONE, ValueTemplate
from pointit.runtime.errors import RefusedError
from pointit.runtime.mqtt.discovery import (
    MAX_TEXT,
    MAX_TOPIC,
    LightConfig,
    availabilities,
    items,
    json_value,
    label,
    mapping,
    name_of,
    text,
)
from pointit.schemas.text import one_line

SCHEMAS = ("default", "basic", "json")
"""Values of `schema`; `basic` is the former name of `default`."""
MAX_BRIGHTNESS = 255
MAX_SCALE = 1_000_000
"""Limit of `brightness_scale`. Lights have up to 65 535."""
MAX_ENTITY = 100
"""Characters of the name of an entity that are taken from an announcement."""
ON_COMMAND_TYPES = ("last", "first", "brightness")
AVAILABILITY_MODES = ("latest", "all", "any")
MAX_AVAILABILITIES = 20
MAX_SLASHES = 200
"""Limit of a topic's slashes: Mosquitto ends the connection of a client that subscribes to more."""
FLAGS = {
    **dict.fromkeys(("1", "true", "yes", "on", "enable"), True),
    **dict.fromkeys(("0", "false", "no", "off", "disable"), False),
}
"""Words for a boolean, as Home Assistant reads them."""
UNKNOWN = "unknown"
_NOT_OF_ENTITIES = re.compile(r"[^a-z0-9_]")
_NOT_OF_TOPICS = re.compile(
    "^\\$share/|[#+\\x00-\\x1f\\x7f-\\x9f\\ufdd0-\\ufdef"
    + "".join(chr(plane * 0x10000 + last) for plane in range(17) for last in (0xFFFE, 0xFFFF))
    + "]"
)
"""Wildcards, filters that clients share, and characters for which brokers may end the connection."""


class LightCommand(NamedTuple):
    """A message to a light."""

    topic: str
    payload: str
    retain: bool = False


@dataclass(frozen=True)
class Availability:
    """Topic that reports if a light is available, and the words for it."""

    topic: str
    template: ValueTemplate
    available: str
    unavailable: str


class AnnouncedLight:
    """A light with the schema `default`."""

    def __init__(self, config: LightConfig) -> None:
        """Read an announcement.

        Raises:
            RefusedError: If it cannot be switched as it is announced. One sentence with its name.
        """
        self.config = config
        self._fields = config.fields
        self.entity = entity_of(config.key)
        """Name of the entity: the same as long as the light has the same `unique_id`."""
        self.name = one_line(name_of(config.fields) or config.key, MAX_TEXT)
        device = mapping(config.fields.get("device"))
        self.area = label(device.get("suggested_area"))
        self._is_group = text(device.get("model")) == "Group"  # of Zigbee2MQTT: its lamps may differ
        if "~" in config.fields:
            self._topic("~")
        self._command_topic = self._topic("command_topic")
        self._state_topic = self._topic("state_topic")
        if not self._command_topic:
            raise self._refusal("has no `command_topic`")
        if config.fields.get("encoding", "utf-8") != "utf-8":
            raise self._refusal("has an `encoding` other than utf-8")
        self._retains = self._flag("retain")
        self._scale = self._read_scale()
        self._is_optimistic = self._flag("optimistic") or not self._state_topic

        # What it has reported
        self._is_on: bool | None = None
        self._level: int | None = None
        """Brightness in its own scale."""
        self._effect = ""
        self._mode = self._choice("availability_mode", AVAILABILITY_MODES)
        self._availabilities = self._read_availabilities()
        self._available: dict[str, bool] = {}
        """Last report of each availability topic."""
        self._last_available = False
        self._read_schema()

    def _read_schema(self) -> None:
        """Read what the schema has. Raises RefusedError."""
        template = self._fields.get("state_value_template", self._fields.get("value_template"))
        self._state_template = self._template("state_value_template", template)
        self._on = self._word("payload_on", "ON")
        self._off = self._word("payload_off", "OFF")
        self._on_command_type = self._choice("on_command_type", ON_COMMAND_TYPES)
        self._brightness_topic = self._topic("brightness_command_topic")
        self._level_topic = self._topic("brightness_state_topic")
        brightness_template = self._fields.get("brightness_value_template")
        self._level_template = self._template("brightness_value_template", brightness_template)
        if self._on_command_type != "brightness":
            return
        if not self._brightness_topic or "brightness_command_template" in self._fields:
            raise self._refusal("is switched on by a brightness without a topic, or with a template, for it")

    @property
    def topics(self) -> set[str]:
        """Return the topics on which it reports."""
        reported = {self._state_topic, self._level_topic}
        return {each.topic for each in self._availabilities} | reported - {""}

    @property
    def request(self) -> LightCommand | None:
        """Return the message that asks for its state, or None if it reports by itself or cannot be asked.

        Zigbee2MQTT retains no states unless it is told to, but answers (https://www.zigbee2mqtt.io, "get").
        """
        return None

    @property
    def is_known(self) -> bool:
        """Return True if it has reported whether it is on."""
        return self._is_on is not None

    @property
    def can_dim(self) -> bool:
        """Return True if a brightness can be commanded."""
        return bool(self._brightness_topic) and "brightness_command_template" not in self._fields

    @property
    def state(self) -> dict[str, Any]:
        """Return its state in the form of Home Assistant."""
        name = UNKNOWN
        if not self._is_available:
            name = UNAVAILABLE
        elif self._is_on is not None:
            name = "on" if self._is_on else "off"
        attributes: dict[str, Any] = {"friendly_name": self.name}
        brightness = self._brightness
        if brightness is not None:
            attributes["brightness"] = brightness
        if self._effect:
            attributes["effect"] = self._effect
        if self._is_group:
            attributes["group"] = True
        return {"entity_id": self.entity, "state": name, "attributes": attributes}

    def on_message(self, topic: str, payload: bytes) -> None:
        """Note what the light reports. Empty messages, and what it does not announce, say nothing."""
        for availability in self._availabilities:
            if availability.topic == topic:
                word = availability.template.value_of(payload)
                if word in (availability.available, availability.unavailable):
                    self._last_available = word == availability.available
                    self._available[topic] = self._last_available
        if topic == self._state_topic:
            self._on_state(payload)
        if topic == self._level_topic:
            self._on_level(self._level_template.value_of(payload))

    def commands(self, *, is_on: bool, brightness: int | None = None) -> Sequence[LightCommand]:
        """Return the messages that switch it, to a `brightness` of 1 to 255 if it is not None."""
        if not is_on:
            return [self._command(self._command_topic, self._off)]
        level = None if brightness is None else self._level_of(brightness)
        if self._on_command_type == "brightness" and level is None:
            level = self._level or self._scale
        switching = [self._command(self._command_topic, self._on)]
        if level is None or not self._brightness_topic:
            return switching
        dimming = [self._command(self._brightness_topic, str(level))]
        if self._on_command_type == "brightness":
            return dimming
        return switching + dimming if self._on_command_type == "first" else dimming + switching

    def assume(self, *, is_on: bool) -> bool:
        """Store the commanded state of a light that reports none. Return True if it is such a light."""
        if self._is_optimistic:
            self._is_on = is_on
        return self._is_optimistic

    def _on_state(self, payload: bytes) -> None:
        word = self._state_template.value_of(payload)
        if word == self._on:
            self._is_on = True
        elif word == self._off:
            self._is_on = False
        elif word == NONE:
            self._is_on = None

    def _on_level(self, word: str) -> None:
        """Note a brightness. One that it cannot have is unknown: the last one would be restored wrongly."""
        if not word:
            return
        self._level = None
        try:
            level = float(word)
        except ValueError:
            return
        if level.is_integer() and 0 <= level <= self._scale:
            self._level = int(level)

    @property
    def _brightness(self) -> int | None:
        """Return its brightness, 1 to 255, or None if it has none that can be set exactly."""
        if not self.can_dim:
            return None
        is_exact = self._scale <= MAX_BRIGHTNESS
        if not is_exact or not self._level or not self._is_on:
            return None
        return max(round(self._level * MAX_BRIGHTNESS / self._scale), 1)

    def _level_of(self, brightness: int) -> int:
        return max(round(brightness * self._scale / MAX_BRIGHTNESS), 1)

    @property
    def _is_available(self) -> bool:
        if not self._availabilities:
            return True
        if self._mode == "latest":
            return self._last_available
        reports = [self._available.get(each.topic, False) for each in self._availabilities]
        return all(reports) if self._mode == "all" else any(reports)

    def _command(self, topic: str, payload: str) -> LightCommand:
        return LightCommand(topic, payload, self._retains)

    # Announcements.

    def _read_availabilities(self) -> list[Availability]:
        has_both = self._fields.get("availability") is not None
        if has_both and self._fields.get("availability_topic") is not None:
            raise self._refusal("has both an `availability` and an `availability_topic`")
        listed: list[Availability] = []
        for entry in availabilities(self._fields):
            template = self._template("availability", entry.get("value_template"))
            available = _word_of(entry.get("payload_available", "online"))
            unavailable = _word_of(entry.get("payload_not_available", "offline"))
            if available is None or unavailable is None:
                raise self._refusal("has an availability without words")
            topic = self._checked_topic(entry.get("topic"), "an availability `topic`")
            listed.append(Availability(topic, template, available, unavailable))
            if len(listed) > MAX_AVAILABILITIES:
                raise self._refusal(f"has more than {MAX_AVAILABILITIES} topics of availability")
        return listed

    def _read_scale(self) -> int:
        value = self._fields.get("brightness_scale", MAX_BRIGHTNESS)
        scale = 0
        if isinstance(value, int | float | str) and not isinstance(value, bool):
            with contextlib.suppress(ValueError, OverflowError):
                scale = int(value)
        if scale < 1:
            raise self._refusal("has a `brightness_scale` that is no number above 0")
        if scale > MAX_SCALE:
            raise self._refusal(f"has a `brightness_scale` above {MAX_SCALE}")
        return scale

    def _topic(self, key: str) -> str:
        """Return the topic in a field, `""` if there is none. Raises RefusedError: it is not a topic."""
        value = self._fields.get(key)
        if value is None:
            return ""
        return self._checked_topic(value, f"a `{key}`")

    def _checked_topic(self, value: object, name: str) -> str:
        if not isinstance(value, str) or not value or _NOT_OF_TOPICS.search(value):
            raise self._refusal(f"has {name} that is no topic")
        if len(value) > MAX_TOPIC:
            raise self._refusal(f"has {name} of {len(value)} characters, limit {MAX_TOPIC}")
        if value.count("/") > MAX_SLASHES:
            raise self._refusal(f"has {name} with more than {MAX_SLASHES} slashes")
        return value

    def _flag(self, key: str) -> bool:
        """Return the boolean in a field, False if there is none."""
        value = self._fields.get(key)
        if value is None:
            return False
        flag: bool | None = None
        if isinstance(value, bool | int | str):
            flag = FLAGS.get(str(value).lower())
        if flag is None:
            raise self._refusal(f"has a `{key}` that is neither true nor false")
        return flag

    def _word(self, key: str, default: str) -> str:
        word = _word_of(self._fields.get(key, default))
        if word is None:
            raise self._refusal(f"has a `{key}` that is no text")
        return word

    def _choice(self, key: str, choices: Sequence[str]) -> str:
        """Return the value of a field, the first of `choices` if there is none."""
        value = self._fields.get(key, choices[0])
        if value not in choices:
            raise self._refusal(f"has a `{key}` other than {', '.join(choices)}")
        return str(value)

    def _template(self, key: str, template: object) -> ValueTemplate:
        try:
            return ValueTemplate.parse(template)
        except ValueError:
            raise self._refusal(f"has a template in `{key}` that is more than one value") from None

    def _refusal(self, reason: str) -> RefusedError:
        return RefusedError(f"{self.name} cannot be used: it {reason}; switch it by a Home Assistant instead")


class AnnouncedJsonLight(AnnouncedLight):
    """A light with the schema `json`: one topic for all that it is told, and one for all that it reports."""

    def _read_schema(self) -> None:
        self._level_topic = ""
        origin = mapping(self._fields.get("origin"))
        self._is_zigbee = text(origin.get("name")) == "Zigbee2MQTT"
        modes = {text(mode) for mode in items(self._fields.get("supported_color_modes"))}
        self._has_levels = modes != {"onoff"}

    @property
    def can_dim(self) -> bool:
        """Return True if a brightness can be commanded."""
        return self._has_levels

    @property
    def request(self) -> LightCommand | None:
        """Return the message by which a Zigbee2MQTT is asked for the state."""
        base = self._command_topic.removesuffix("/set")
        if not self._is_zigbee or base == self._command_topic:
            return None
        return LightCommand(f"{base}/get", '{"state":""}')

    def commands(self, *, is_on: bool, brightness: int | None = None) -> Sequence[LightCommand]:
        """Return the message that switches it, to a `brightness` of 1 to 255 if it is not None."""
        message: dict[str, Any] = {"state": "ON" if is_on else "OFF"}
        if is_on and brightness is not None:
            message["brightness"] = self._level_of(brightness)
        payload = json.dumps(message, separators=(",", ":"))
        return [self._command(self._command_topic, payload)]

    def _on_state(self, payload: bytes) -> None:
        message = mapping(json_value(payload))
        if "state" in message:
            self._is_on = {"ON": True, "OFF": False}.get(str(message["state"]))
        if "brightness" in message:
            level = message["brightness"]
            self._on_level(str(level) if isinstance(level, int | float | str) else UNKNOWN)
        if "effect" in message:
            self._effect = label(message["effect"])


def light_of(config: LightConfig) -> AnnouncedLight:
    """Return the light of an announcement. Raises RefusedError: it cannot be switched as it is announced."""
    schema = config.fields.get("schema", "default")
    if schema == "json":
        return AnnouncedJsonLight(config)
    if schema in SCHEMAS:
        return AnnouncedLight(config)
    name = one_line(name_of(config.fields) or config.key, MAX_TEXT)
    shown_schema = text(schema) or "no text"
    raise RefusedError(
        f"{name} cannot be used: its `schema` is {shown_schema}, and PointIt knows default and json; "
        "switch it by a Home Assistant instead"
    )


def entity_of(key: str) -> str:
    """Return the name of the entity of a light with `key`, different for each."""
    clean = _NOT_OF_ENTITIES.sub("_", key.lower())[:MAX_ENTITY]
    return f"light.{clean}" if clean == key else f"light.{clean}_{zlib.crc32(key.encode()):08x}"


def _word_of(value: object) -> str | None:
    """Return a word of a device as Home Assistant reads it, or None if it is no text, number or boolean."""
    if isinstance(value, str | int | float):
        return str(value)
    return None
