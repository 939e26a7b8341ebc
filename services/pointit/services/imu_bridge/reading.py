"""Readings of a source of orientations, and its interface."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from pointit.geometry.rotation import Quaternion


@dataclass(frozen=True, slots=True)
class Reading:
    """One orientation of the sensor."""

    stamp_ns: int
    """Host time of capture, or of arrival if the device does not state it."""
    world_from_sensor: Quaternion
    device_time_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Press:
    """A gesture on the device's button."""

    stamp_ns: int
    gesture: Literal["press", "double", "hold"] = "press"


@dataclass(frozen=True, slots=True)
class Reconnected:
    """The device was connected, perhaps again: it may have been restarted, or be another one."""


Item = Reading | Press | Reconnected

Deliver = Callable[[Item], None]
"""Callback for readings, called in the event loop."""


class Source(Protocol):
    """A source of orientations."""

    async def run(self, deliver: Deliver) -> None:
        """Deliver readings until cancelled."""
        ...
