"""Messages of smart lights over MQTT: JSON as Zigbee2MQTT and the JSON schema of Home Assistant have it."""

import json
from typing import Any, cast

from pointit.schemas.base import Rgb

FULL = 254
"""Full brightness of Zigbee; Home Assistant's scale ends at 255, which Zigbee2MQTT does not take."""


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


def availability(payload: object) -> bool | None:
    """Return True if a lamp tells that it is online, False for offline, None for anything else.

    Args:
        payload: `online` or `offline`, or an object with one of them as `state`.
    """
    value = parsed(payload)
    if isinstance(value, dict):
        value = cast("dict[str, Any]", value).get("state")
    return {"online": True, "offline": False}.get(value) if isinstance(value, str) else None


def parsed(payload: object) -> object:
    """Return the value of a message that is JSON, its text if it is not, or None if it is no text."""
    if not isinstance(payload, bytes | bytearray):
        return None
    try:
        text = payload.decode()
    except UnicodeDecodeError:
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text
