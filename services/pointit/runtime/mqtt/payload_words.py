"""Words by which devices of other makers tell one state: plain, in JSON, or as a field of an object. Pure."""

import json
from typing import Any, cast

FIELDS = ("state", "status", "availability", "available", "online", "connected", "value")
"""Fields of an object that have the state, the first that there is."""
ONLINE = frozenset(
    ("online", "connected", "available", "alive", "awake", "up", "ready", "alert", "true", "yes", "1", "2")
)
"""Words of Zigbee2MQTT, ESPHome, WLED, Tasmota, Shelly, milight-hub, zwave-js-ui, Homie and mqtt-smarthome.

`on` and `off` are not among them: they are the state of a lamp, which is reachable in both."""
OFFLINE = frozenset(
    (
        *("offline", "disconnected", "disconnected_clean", "disconnected_unclean", "unavailable", "dead"),
        *("asleep", "sleeping", "down", "init", "lost", "false", "no", "0"),
    )
)
ON, OFF = frozenset(("on", "true", "1")), frozenset(("off", "false", "0"))


def parsed(payload: object) -> object:
    """Return the value of a message that is JSON, its text if it is not, or None if it is no text."""
    if not isinstance(payload, bytes | bytearray):
        return None
    try:
        text = payload.decode("utf-8-sig").strip("\0 \t\r\n")
    except UnicodeDecodeError:
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


def word_in(payload: object) -> str:
    """Return the word of a message in small letters, or `""` if it has none."""
    value = parsed(payload)
    if isinstance(value, dict):
        fields = {key.casefold(): each for key, each in cast("dict[str, Any]", value).items()}
        value = next((fields[name] for name in FIELDS if name in fields), None)
    if isinstance(value, bool | int):
        return str(value).casefold()
    return value.strip().casefold() if isinstance(value, str) else ""


def is_online(payload: object, online: str = "", offline: str = "") -> bool | None:
    """Return True if a device tells that it is online, False for offline, None for anything else.

    Args:
        payload: the message.
        online: word for online, in place of the usual ones if not empty.
        offline: word for offline, likewise.
    """
    return _choose(word_in(payload), _own(online) or ONLINE, _own(offline) or OFFLINE)


def is_on(payload: object) -> bool | None:
    """Return True if a message switches on, False for off, None for anything else."""
    return _choose(word_in(payload), ON, OFF)


def _own(word: str) -> frozenset[str]:
    return frozenset((word.strip().casefold(),)) if word else frozenset()


def _choose(word: str, true: frozenset[str], false: frozenset[str]) -> bool | None:
    return True if word in true else False if word in false else None
