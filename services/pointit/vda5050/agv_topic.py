"""MQTT topics of AGVs: `INTERFACE/vMAJOR/MANUFACTURER/SERIAL_NUMBER/KIND`, or with another beginning."""

import re
from typing import NamedTuple

KINDS = ("connection", "state", "visualization")
MAX_PREFIX_LEVELS = 4
"""Maximum number of levels before the manufacturer. The standard has two; some sites have others."""

_VERSION = re.compile(r"v?(\d)(\.\d+)*\Z", re.IGNORECASE)


class AgvTopic(NamedTuple):
    """Topic of an AGV."""

    prefix: str
    """Levels before the manufacturer."""
    manufacturer: str
    serial_number: str
    kind: str
    """One of `KINDS`."""

    @property
    def name(self) -> str:
        """Return the name of the AGV, `MANUFACTURER/SERIAL_NUMBER`."""
        return f"{self.manufacturer}/{self.serial_number}"

    @property
    def major(self) -> str:
        """Return the major version of VDA 5050 that the prefix ends with (`v2`, `2.0`), or `""`."""
        match = _VERSION.match(self.prefix.rpartition("/")[2])
        return match[1] if match else ""


def agv_of_topic(topic: str) -> AgvTopic | None:
    """Return the AGV of a topic, or None if it belongs to no AGV."""
    prefix, *last = topic.rsplit("/", 3)
    if len(last) < 3 or prefix.count("/") >= MAX_PREFIX_LEVELS:
        return None
    manufacturer, serial_number, kind = last
    is_of_agv = manufacturer and serial_number and kind in KINDS
    return AgvTopic(prefix, manufacturer, serial_number, kind) if is_of_agv else None


def agv_topics() -> tuple[str, ...]:
    """Return the patterns that match the topics of every AGV."""
    return tuple(
        f"{'+/' * (levels + 2)}{kind}" for kind in KINDS for levels in range(1, MAX_PREFIX_LEVELS + 1)
    )
