"""What a source of orientations hands over, and what a source is."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from pointit.geometry.rotation import Quaternion


@dataclass(frozen=True, slots=True)
class Reading:
    """One orientation of the sensor."""

    stamp_ns: int
    """Host time of capture, or of arrival where the device does not say."""
    world_from_sensor: Quaternion
    device_time_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Press:
    """The device's button."""

    stamp_ns: int
    gesture: Literal["press", "double", "hold"] = "press"


@dataclass(frozen=True, slots=True)
class Reconnected:
    """The device is there, perhaps again: it may have been restarted, or be another one."""


Item = Reading | Press | Reconnected

Deliver = Callable[[Item], None]
"""Takes what came, in the loop."""


class Source(Protocol):
    """Where orientations come from."""

    async def run(self, deliver: Deliver) -> None:
        """Hand over what comes until cancelled."""
        ...
