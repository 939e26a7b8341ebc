"""How fast a ray turns: a robust estimate over a fraction of a second."""

import math
from collections.abc import Sequence

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S

FEWEST = 2
"""Rays without which there is no speed."""


class RaySpeedEstimator:
    """Keeps the last directions of one person's ray and says how fast it turns.

    The rays of the window are cut in two halves; the speed is the way from the median direction of the
    older to that of the newer, over the time between. A single wrong sample changes a median little, and
    tremor of 6 to 12 Hz, whose momentary speed is as high as that of slow pointing, is levelled out.
    """

    def __init__(self, window_s: float) -> None:
        self._window_ns = round(window_s * NS_PER_S)
        self._stamps_ns: list[int] = []
        self._azimuths: list[float] = []
        """Without jumps at half a turn."""
        self._elevations: list[float] = []

    def clear(self) -> None:
        """Forget all rays."""
        self._stamps_ns.clear()
        self._azimuths.clear()
        self._elevations.clear()

    def add(self, stamp_ns: int, direction: Vec3) -> None:
        """Take the ray of `stamp_ns`, later than those before, with its unit direction in {W}."""
        stamps_ns, azimuths = self._stamps_ns, self._azimuths
        azimuth = vector.azimuth(direction)
        if azimuths:
            azimuth = azimuths[-1] + vector.wrap(azimuth - azimuths[-1])
        stamps_ns.append(stamp_ns)
        azimuths.append(azimuth)
        self._elevations.append(vector.elevation(direction))
        oldest_ns = stamp_ns - self._window_ns
        old = 0
        while len(stamps_ns) - old > FEWEST and stamps_ns[old] < oldest_ns:
            old += 1
        if old:
            del stamps_ns[:old], azimuths[:old], self._elevations[:old]

    def rate(self) -> tuple[float, float] | None:
        """Return the speed towards greater azimuth (on the sphere) and up, rad/s; none: not known yet."""
        count = len(self._stamps_ns)
        if count < FEWEST:
            return None
        half = count // 2  # of an odd number the middle one is in neither
        first_ns = self._stamps_ns[0]  # a time of day in ns has more digits than a float
        ages_ns = [stamp_ns - first_ns for stamp_ns in self._stamps_ns]
        span_ns = _median(ages_ns[-half:]) - _median(ages_ns[:half])
        turned = _median(sorted(self._azimuths[-half:])) - _median(sorted(self._azimuths[:half]))
        raised = _median(sorted(self._elevations[-half:])) - _median(sorted(self._elevations[:half]))
        per_s = NS_PER_S / span_ns
        return turned * math.cos(self._elevations[-1]) * per_s, raised * per_s


def _median(ordered: Sequence[float]) -> float:
    middle = len(ordered) // 2
    return ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2.0
