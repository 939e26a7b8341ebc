"""Lights that announce themselves on one broker, by entity, and sentences on those that are left out. Pure.

One device cannot keep another's lights out by many announcements: each has a limit of its own. The first
announcement of a `unique_id` counts, as in Home Assistant. A client that announces in the name of many
devices, or of another one, is a matter of the broker's access list: MQTT does not tell who sent a message.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from pointit.bridges.home_assistant.mqtt.announced_light import AnnouncedLight, light_of
from pointit.bridges.home_assistant.mqtt.tasmota_light import (
    DISCOVERY,
    TasmotaLight,
    is_tasmota,
    tasmota_configs,
)
from pointit.runtime.errors import RefusedError
from pointit.runtime.mqtt.discovery import (
    LightConfig,
    json_value,
    light_configs,
    mapping,
)
from pointit.schemas.text import one_line

MAX_LIGHTS = 500
MAX_LIGHTS_OF_DEVICE = 64
"""Limit of the lights of one device, or of one announcement. A bus of DALI has 64 addresses."""
MAX_REFUSED_TOPICS = 500
"""Limit of the topics with sentences."""
MAX_REFUSAL = 300
MAX_SHOWN_TOPIC = 100
MAX_DEVICE = 1000
"""Characters of the identifiers of a device that are compared."""


@dataclass
class LightEntry:
    """A light, the topic on which it announces itself, and its device."""

    light: AnnouncedLight
    topic: str
    device: str
    context: str = ""
    """Context of the last command."""
    command_s: float = -math.inf
    topics: frozenset[str] = field(init=False)
    """Topics on which it reports."""

    def __post_init__(self) -> None:
        """Note the topics, which are asked for with each message."""
        self.topics = frozenset(self.light.topics)


@dataclass
class AnnouncedChange:
    """Effect of an announcement: entities that are no more, and lights that are new or have changed."""

    removed: list[str] = field(default_factory=list)
    entries: list[LightEntry] = field(default_factory=list)


class AnnouncedLights:
    """Lights that were announced so far."""

    def __init__(self, broker: str, prefix: str) -> None:
        """Begin without lights. `broker`: its address; `prefix`: that of the discovery."""
        self._broker = broker
        self._prefix = prefix
        self.entries: dict[str, LightEntry] = {}
        """Lights by entity."""
        self._refusals: dict[str, list[str]] = {}
        """Sentences on what cannot be used, by the topic of its message."""
        self._has_more_refusals = False
        self._without_lights: set[str] = set()
        """Topics of devices that have announced themselves without a light."""

    @property
    def refusals(self) -> Sequence[str]:
        """Return sentences on lights and messages that cannot be used."""
        sentences: list[str] = []
        for listed in self._refusals.values():
            sentences += listed
        sentences.sort()
        if self._has_more_refusals:
            sentences.append(f"{self._broker} has further lamps that cannot be used")
        return sentences

    @property
    def reason_of_none(self) -> str:
        """Return why there is no light, and what to do, or `""` if there is one, or a sentence on one."""
        if self.entries or self._refusals:
            return ""
        places = f"{self._prefix}/light/, {self._prefix}/device/ and {DISCOVERY}/"
        number = len(self._without_lights)
        if not number:
            return (
                f"nothing has announced itself to {self._broker} below {places}: switch the discovery of "
                "Home Assistant on in your lamps or their gateway, start them again, or set the variable "
                "MQTT_DISCOVERY_PREFIX if they use another prefix"
            )
        reason = f"{number} devices without a light have announced themselves to {self._broker}"
        if any(map(is_tasmota, self._without_lights)):
            return f"{reason}: of a Tasmota, `SetOption30 1` makes its relay a light"
        return f"{reason}, and no lamp: switch the discovery of Home Assistant on in your lamps"

    @property
    def topics(self) -> set[str]:
        """Return the topics on which the lights report."""
        topics: set[str] = set()
        for entry in self.entries.values():
            topics |= entry.topics
        return topics

    def refusals_of(self, topic: str) -> Sequence[str]:
        """Return the sentences on messages of `topic`."""
        return self._refusals.get(topic, ())

    def refuse(self, topic: str, sentence: str) -> None:
        """Add a sentence on a message of `topic` that cannot be used."""
        if topic not in self._refusals and len(self._refusals) >= MAX_REFUSED_TOPICS:
            self._has_more_refusals = True
            return
        sentences = self._refusals.setdefault(topic, [])
        if len(sentences) >= MAX_LIGHTS_OF_DEVICE:
            self._has_more_refusals = True
            return
        sentences.append(one_line(sentence, MAX_REFUSAL))

    def clear_refusals(self, topic: str) -> None:
        """Forget the sentences on messages of `topic`, since there is a new one."""
        self._refusals.pop(topic, None)

    def on_announcement(self, topic: str, payload: bytes) -> AnnouncedChange:
        """Add the lights that a message announces, in place of those that its topic announced before.

        `topic` is one of announcements below the prefix.
        """
        self.clear_refusals(topic)
        change = AnnouncedChange()
        lights = self._lights_in(topic, payload)
        self._without_lights.discard(topic)
        is_device = bool(payload) and not lights and topic not in self._refusals
        if is_device and len(self._without_lights) < MAX_REFUSED_TOPICS:
            self._without_lights.add(topic)

        # Lights that are announced no more
        for entity, entry in list(self.entries.items()):
            if entry.topic == topic and entity not in lights:
                del self.entries[entity]
                change.removed.append(entity)

        # What is announced once more without a change keeps what it has reported
        for entity, (config, light) in lights.items():
            entry = self.entries.get(entity)
            if entry is not None and (entry.topic, entry.light.config) == (topic, config):
                continue
            device = _device_of(config, topic)
            reason = self._reason_against(entity, topic, device)
            if reason:
                self.refuse(topic, f"{light.name} is left out: {reason}")
                continue
            entry = LightEntry(light, topic, device)
            self.entries[entity] = entry
            change.entries.append(entry)
        return change

    def _lights_in(self, topic: str, payload: bytes) -> dict[str, tuple[LightConfig, AnnouncedLight]]:
        """Return the lights of an announcement that can be used, by entity."""
        shown_topic = one_line(topic, MAX_SHOWN_TOPIC)
        is_object = isinstance(json_value(payload), dict)
        if payload and not is_object:
            self.refuse(topic, f"the announcement on {shown_topic} cannot be used: it is no object in JSON")
            return {}
        lights: dict[str, tuple[LightConfig, AnnouncedLight]] = {}
        make_light = light_of
        configs = light_configs(topic, payload, self._prefix)
        if is_tasmota(topic):
            make_light = TasmotaLight
            configs = tasmota_configs(payload)
        for config in configs:
            try:
                light = make_light(config)
            except RefusedError as error:
                self.refuse(topic, str(error))
                continue
            if light.entity in lights:
                self.refuse(topic, f"{light.name} is left out: {shown_topic} announces it twice")
                continue
            lights[light.entity] = (config, light)
        return lights

    def _reason_against(self, entity: str, topic: str, device: str) -> str:
        """Return the reason for which a light that is new or has changed is left out, or `""`."""
        entry = self.entries.get(entity)
        if entry is not None:
            if entry.topic == topic:
                return ""
            shown_topic = one_line(entry.topic, MAX_SHOWN_TOPIC)
            return f"it has the `unique_id` of {entry.light.name}, which {shown_topic} has announced before"
        if self._count_neighbors(topic, device) >= MAX_LIGHTS_OF_DEVICE:
            return f"its device has more than {MAX_LIGHTS_OF_DEVICE} lamps"
        if len(self.entries) >= MAX_LIGHTS:
            return (
                f"{self._broker} has more than {MAX_LIGHTS} lamps; remove the announcements of those "
                "that are gone, and start PointIt again"
            )
        return ""

    def _count_neighbors(self, topic: str, device: str) -> int:
        """Return the number of lights of a device, and of those in the same announcement."""
        count = 0
        for entry in self.entries.values():
            if entry.device == device or entry.topic == topic:
                count += 1
        return count


def _device_of(config: LightConfig, topic: str) -> str:
    """Return the identifiers of the device of a light, or the topic of its announcement if it has none."""
    identifiers = mapping(config.fields.get("device")).get("identifiers")
    if not identifiers:
        return topic
    return json.dumps(identifiers, sort_keys=True)[:MAX_DEVICE]
