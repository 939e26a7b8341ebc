"""Readings of a source of orientations, its interface, and the check of what it delivers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S

MAX_ITEMS_PER_S = 1000
"""Items per second of the clock beyond which the rest of that second is refused."""
UNIT_TOLERANCE = 0.05
"""Largest deviation of the squared norm of an orientation from 1."""
SHOWN_NS = 5 * NS_PER_S
"""Time for which a problem is reported, ns."""


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


class ReadingCheck:
    """Refuses what would harm the person's other services, and says why."""

    def __init__(self) -> None:
        self.is_refused = False
        """True if the last item must not be used."""
        self._second = 0
        self._count = 0
        self._problem = ""
        self._problem_ns = 0

    def problem(self, item: Item, now_ns: int) -> str:
        """Check `item`, delivered at `now_ns`. Return the problem of the last seconds, or `""`."""
        second = now_ns // NS_PER_S
        if second != self._second:
            self._second, self._count = second, 0
        self._count += 1
        found = ""
        if self._count > MAX_ITEMS_PER_S:
            found = f"delivers more than {MAX_ITEMS_PER_S} readings a second; the rest is dropped"
        elif isinstance(item, Reading):
            x, y, z, w = item.world_from_sensor
            norm2 = x * x + y * y + z * z + w * w
            if not abs(norm2 - 1.0) <= UNIT_TOLERANCE:  # also if it is not a number
                found = f"delivers orientations of norm {norm2**0.5:.3g}; they are dropped: it must be 1"
        self.is_refused = bool(found)
        if found:
            self._problem, self._problem_ns = found, now_ns
        elif self._problem and not 0 <= now_ns - self._problem_ns < SHOWN_NS:
            self._problem = ""
        return self._problem
