"""Announcements of lights by Home Assistant's MQTT discovery, whatever a broker may deliver. Pure.

https://www.home-assistant.io/integrations/mqtt, "MQTT discovery": a light has a topic of its own, or is a
component of a device. Keys may be abbreviated, and topics may begin or end with `~`, the base topic.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, cast

ABBREVIATIONS = {
    "avty": "availability",
    "avty_mode": "availability_mode",
    "avty_t": "availability_topic",
    "avty_tpl": "availability_template",
    "bri_cmd_t": "brightness_command_topic",
    "bri_cmd_tpl": "brightness_command_template",
    "bri_scl": "brightness_scale",
    "bri_stat_t": "brightness_state_topic",
    "bri_val_tpl": "brightness_value_template",
    "cmd_t": "command_topic",
    "cmps": "components",
    "dev": "device",
    "e": "encoding",
    "ids": "identifiers",
    "mdl": "model",
    "mf": "manufacturer",
    "o": "origin",
    "on_cmd_type": "on_command_type",
    "opt": "optimistic",
    "p": "platform",
    "pl_avail": "payload_available",
    "pl_not_avail": "payload_not_available",
    "pl_off": "payload_off",
    "pl_on": "payload_on",
    "ret": "retain",
    "sa": "suggested_area",
    "stat_t": "state_topic",
    "stat_val_tpl": "state_value_template",
    "sup_clrm": "supported_color_modes",
    "t": "topic",
    "uniq_id": "unique_id",
    "val_tpl": "value_template",
}
"""Keys by their short names, of those that are read."""
CONFIG = "/config"
"""End of the topic of an announcement."""
MAX_TEXT = 200
"""Characters of a name. Longer ones are cut, and other texts are left out."""
MAX_TOPIC = 1000
"""Characters of a topic. MQTT has more, but one message could repeat a long base topic hundreds of times."""


class LightConfig(NamedTuple):
    """Announcement of a light: `key` differs for each on one broker, `fields` have full names and topics."""

    key: str
    fields: Mapping[str, Any]


def discovery_topics(prefix: str) -> tuple[str, ...]:
    """Return the topic filters of announcements of lights and devices below `prefix`."""
    return f"{prefix}/light/#", f"{prefix}/device/#"


def is_announcement(topic: str, prefix: str) -> bool:
    """Return True for a topic on which a light or a device announces itself."""
    return topic.endswith(CONFIG) and topic.startswith((f"{prefix}/light/", f"{prefix}/device/"))


def light_configs(topic: str, payload: object, prefix: str) -> list[LightConfig]:
    """Return the lights that a message announces. None for any other message."""
    value = json_value(payload)
    if not is_announcement(topic, prefix) or not isinstance(value, dict):
        return []
    fields = _full_names(cast("dict[str, Any]", value))
    name = topic.removesuffix(CONFIG)
    if topic.startswith(f"{prefix}/light/"):
        return [_light_config(name.removeprefix(f"{prefix}/light/"), fields)]

    # Components of a device share its fields
    lights: list[LightConfig] = []
    for component_id, item in mapping(fields.get("components")).items():
        component = _full_names(mapping(item))
        is_removed = component.keys() == {"platform"}
        if component.get("platform") == "light" and not is_removed:
            name_on_device = f"{name.removeprefix(f'{prefix}/device/')}/{component_id}"
            lights.append(_light_config(name_on_device, {**fields, **component}))
    return lights


def name_of(fields: Mapping[str, Any]) -> str:
    """Return the name of a light: its own, else that of its device, else `""`."""
    device = mapping(fields.get("device"))
    return label(fields.get("name")) or label(device.get("name"))


def availabilities(fields: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield the entries of a light's availability: `topic`, words, and `value_template`.

    They are as they were announced, so that they may lack a topic, or have anything else as one.
    """
    own_topic = fields.get("availability_topic")
    if own_topic is not None:
        template = fields.get("availability_template")
        yield {**fields, "topic": own_topic, "value_template": template}
    listed = fields.get("availability")
    if isinstance(listed, list):
        yield from map(mapping, items(listed))
    elif listed is not None:
        yield mapping(listed)


def json_value(payload: object) -> object:
    """Return the value of a message in JSON, or None, also if it has texts that no message may have."""
    if not isinstance(payload, bytes | bytearray):
        return None
    try:
        value = json.loads(payload)
        # Half of a surrogate pair is a text of JSON, but neither of MQTT nor of our messages
        json.dumps(value, ensure_ascii=False).encode()
    except (ValueError, RecursionError):
        return None
    return value


def text(value: object) -> str:
    """Return a text of usual length, `""` for anything else."""
    if not isinstance(value, str) or len(value) > MAX_TEXT:
        return ""
    return value


def label(value: object) -> str:
    """Return the begin of a text, `""` for anything else."""
    return value[:MAX_TEXT] if isinstance(value, str) else ""


def topic_text(value: object) -> str:
    """Return a text that may be a topic, `""` for anything else."""
    if not isinstance(value, str) or len(value) > MAX_TOPIC:
        return ""
    return value


def mapping(value: object) -> dict[str, Any]:
    """Return an object of JSON, an empty one for anything else."""
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


def items(value: object) -> list[object]:
    """Return a list of JSON, an empty one for anything else."""
    return cast("list[object]", value) if isinstance(value, list) else []


def _light_config(name: str, fields: Mapping[str, Any]) -> LightConfig:
    key = text(fields.get("unique_id")) or name
    base = topic_text(fields.get("~"))
    if base:
        fields = _with_base(fields, base)
    return LightConfig(key, fields)


def _full_names(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return an object with full names of its keys, also in its device, origin and availability."""
    full = _renamed(fields)
    for key in ("device", "origin", "availability"):
        value = full.get(key)
        if isinstance(value, dict):
            full[key] = _renamed(mapping(value))
        elif key == "availability" and isinstance(value, list):
            full[key] = [_renamed(mapping(item)) for item in items(value)]
    return full


def _renamed(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return an object with full names of its own keys: others may nest objects as deep as they like."""
    return {ABBREVIATIONS.get(key, key): value for key, value in fields.items()}


def _with_base(fields: Mapping[str, Any], base: str) -> dict[str, Any]:
    """Return `fields` with the base topic in place of `~` at the start or end of topics."""
    full = _with_base_topics(fields, base)
    listed = fields.get("availability")
    if isinstance(listed, dict):
        full["availability"] = _with_base_topics(mapping(listed), base)
    elif isinstance(listed, list):
        full["availability"] = [_with_base_topics(mapping(item), base) for item in items(listed)]
    return full


def _with_base_topics(fields: Mapping[str, Any], base: str) -> dict[str, Any]:
    full: dict[str, Any] = {}
    for key, value in fields.items():
        full[key] = value
        if key == "topic" or key.endswith("_topic"):
            full[key] = _with_base_topic(value, base)
    return full


def _with_base_topic(topic: object, base: str) -> object:
    if not isinstance(topic, str):
        return topic
    if topic.startswith("~"):
        return base + topic[1:]
    if topic.endswith("~"):
        return topic[:-1] + base
    return topic
