"""Words by which devices of other makers tell one state: plain, in JSON, or as a field of an object. Pure."""

import functools
import json
import re
from collections.abc import Sequence
from typing import Any, cast

AVAILABILITY = (
    *("availability", "available", "isavailable", "online", "isonline", "reachable", "isreachable"),
    *("connected", "isconnected", "connection", "connectionstate", "connectionstatus", "connectivity"),
    *("alive", "isalive", "lwt"),
)
"""Fields of an object that have the availability only, in small letters without separators."""
NEGATED = ("offline", "isoffline", "disconnected", "unavailable", "unreachable", "lost")
"""Fields that are true for a device that is offline."""
STATES = ("state", "status", "value", "val")
"""Fields that have the availability or another state. The first field of which the word is known counts."""
SWITCHES = ("power", "switch", "on")
"""Fields of a command to a switch, besides `STATES`."""
ONLINE = frozenset(
    (
        *("online", "connected", "available", "reachable", "alive", "awake", "up", "ready", "alert"),
        *("true", "yes", "1", "2"),
    )
)
"""Words of Zigbee2MQTT, ESPHome, ESPEasy, WLED, Tasmota, Shelly, milight-hub, zwave-js-ui, Homie and others.

Separators in words count as spaces. `on` and `off` are not among them: they are the state of a lamp, which is
reachable in both."""
OFFLINE = frozenset(
    (
        *("offline", "disconnected", "disconnected clean", "disconnected unclean", "connection lost"),
        *("unavailable", "not available", "unreachable", "not reachable", "not connected", "no connection"),
        *("not online", "dead", "asleep", "sleeping", "stopped", "down", "init", "lost", "false", "no", "0"),
    )
)
_SEPARATORS = re.compile(r"[\s_$.\-]+")
MAX_DEPTH = 2
"""Limit of objects in one another, of which the fields are read."""
ON, OFF = frozenset(("on", "true", "1")), frozenset(("off", "false", "0"))


def parsed(payload: object) -> object:
    """Return the value of a message that is JSON, its text if it is not, or None if it is no text."""
    text = _text(payload)
    if text is None:
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


@functools.lru_cache(1000)  # a device sends the same ones, and each is read for many lamps
def words_in(payload: object, fields: Sequence[str] = STATES) -> Sequence[str]:
    """Return the words of a message in small letters: all of it, then its value in JSON or its `fields`."""
    text = _text(payload)
    return [] if text is None else [text.casefold(), *_words(parsed(payload), fields, MAX_DEPTH)]


def is_online(payload: object, online: str = "", offline: str = "") -> bool | None:
    """Return True if a device tells that it is online, False for offline, None for anything else.

    Args:
        payload: the message.
        online: word for online, or the whole message, in place of the usual words if not empty.
        offline: word for offline, likewise.
    """
    words = words_in(payload, (*AVAILABILITY, *NEGATED, *STATES))
    return _choose(words, _own(online) or ONLINE, _own(offline) or OFFLINE)


def is_on(payload: object) -> bool | None:
    """Return True if a message switches on, False for off, None for anything else."""
    return _choose(words_in(payload, (*STATES, *SWITCHES)), ON, OFF)


def _text(payload: object) -> str | None:
    if not isinstance(payload, bytes | bytearray):
        return None
    try:
        return payload.decode("utf-8-sig").strip("\0 \t\r\n")
    except UnicodeDecodeError:
        return None


def _words(value: object, fields: Sequence[str], depth: int) -> list[str]:
    if isinstance(value, dict) and depth:
        content = {
            _SEPARATORS.sub("", key.casefold()): each for key, each in cast("dict[str, Any]", value).items()
        }
        return [
            _negated(word) if name in NEGATED else word
            for name in fields
            if name in content
            for word in _words(content[name], fields, depth - 1)
        ]
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return [str(value).strip().casefold()] if isinstance(value, bool | int | str) else []


def _negated(word: str) -> str:
    return {"true": "false", "false": "true", "1": "0", "0": "1", "yes": "no", "no": "yes"}.get(word, "")


def _own(word: str) -> frozenset[str]:
    return frozenset((word.strip().casefold(),)) - {""}


def _choose(words: Sequence[str], true: frozenset[str], false: frozenset[str]) -> bool | None:
    for word in words:
        spellings = {word, _SEPARATORS.sub(" ", word)}
        if spellings & (true | false):
            return bool(spellings & true)
    return None
