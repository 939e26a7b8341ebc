"""Check of what a source delivers: orientations that are none, and floods."""

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.reading import Item, Reading

MAX_ITEMS_PER_S = 1000
"""Items per second of the clock beyond which the rest of that second is refused."""
UNIT_TOLERANCE = 0.05
"""Largest deviation of the squared norm of an orientation from 1."""
SHOWN_NS = 5 * NS_PER_S
"""Time for which a problem is reported, ns."""


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
