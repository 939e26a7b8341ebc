"""Detection of a sensor that was restarted behind an adapter that stayed, so that its yaw has jumped."""

import math

from pointit.geometry import vector
from pointit.geometry.rotation import rotate
from pointit.services.imu_bridge.reading import Item, RawReading, Reading, Reconnected

SILENT_S = 2.0
"""Shortest silence in which a sensor may have been restarted, s."""
LISTENING_S = 0.5
"""Most of the time between two looks at the port that counts as silence, s: a process that had no time heard
nothing."""
NEAR_RAD = math.radians(3.0)
"""Largest yaw of a sensor that has just been started: six-axis fusions begin at 0, rad. The wider, the more
often an arm that turns there in a pause of its radio is taken for a start."""
JUMP_RAD = math.radians(10.0)
"""Smallest change of the yaw that counts, rad. An arm at rest moves less in a pause of its radio."""


class RestartWatch:
    """Compares the yaw before and after each silence."""

    def __init__(self) -> None:
        self._looked_s = math.inf
        self._silent_s = 0.0
        self._newest: Reading | None = None

    def is_silent(self, now_s: float) -> bool:
        """Return True if no reading has come for a while until `now_s`, s; to be called at each look."""
        self._silent_s += min(max(now_s - self._looked_s, 0.0), LISTENING_S)
        self._looked_s = now_s
        return self._newest is not None and self._silent_s >= SILENT_S

    def marked(self, items: list[Item], *, may_be_start: bool) -> list[Item]:
        """Return the `items` of one look at the port, behind a `Reconnected` if they are the first of a run.

        `may_be_start`: a silence was before, and no counter shows that the sensor ran on.
        """
        readings = [item for item in items if isinstance(item, Reading | RawReading)]
        if not readings:
            return items
        before, first, last = self._newest, readings[0], readings[-1]
        self._silent_s = 0.0
        self._newest = last if isinstance(last, Reading) else before
        if not may_be_start or before is None or not isinstance(first, Reading):
            return items
        if first.device_time_ns is not None or Reconnected() in items:
            return items  # the time tells, or the framer has told
        yaw_rad = _yaw_rad(first)
        has_started = abs(yaw_rad) < NEAR_RAD and abs(vector.wrap(yaw_rad - _yaw_rad(before))) > JUMP_RAD
        return [Reconnected(), *items] if has_started else items


def _yaw_rad(reading: Reading) -> float:
    return vector.azimuth(rotate(reading.world_from_sensor, (1.0, 0.0, 0.0)))
