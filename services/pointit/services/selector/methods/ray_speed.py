"""Robust estimate of the angular speed of a ray over a fraction of a second."""

import math
from collections.abc import Sequence

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S

MIN_RAYS = 2
"""Number of rays needed for a speed."""


class RaySpeedEstimator:
    """Angular speed of one person's ray, from its last directions.

    The rays of the window are split in two halves. The speed is the change from the median direction of the
    older half to that of the newer, divided by the time between. A single wrong sample changes a median
    little, and tremor of 6 to 12 Hz, whose momentary speed is as high as that of slow pointing, averages out.
    """

    def __init__(self, window_s: float) -> None:
        self._window_ns = round(window_s * NS_PER_S)
        self._stamps_ns: list[int] = []
        self._azimuths: list[float] = []
        """Unwrapped azimuths, rad."""
        self._elevations: list[float] = []

    def clear(self) -> None:
        """Forget all rays."""
        self._stamps_ns.clear()
        self._azimuths.clear()
        self._elevations.clear()

    def add(self, stamp_ns: int, direction: Vec3) -> None:
        """Add the ray of `stamp_ns`, later than those before, with its unit direction in {W}."""
        stamps_ns, azimuths = self._stamps_ns, self._azimuths
        azimuth = vector.azimuth(direction)
        if azimuths:
            azimuth = azimuths[-1] + vector.wrap(azimuth - azimuths[-1])
        stamps_ns.append(stamp_ns)
        azimuths.append(azimuth)
        self._elevations.append(vector.elevation(direction))
        oldest_ns = stamp_ns - self._window_ns
        old = 0
        while len(stamps_ns) - old > MIN_RAYS and stamps_ns[old] < oldest_ns:
            old += 1
        if old:
            del stamps_ns[:old], azimuths[:old], self._elevations[:old]

    def rate(self) -> tuple[float, float] | None:
        """Return the speed of azimuth (on the sphere) and elevation, rad/s, or None with too few rays."""
        count = len(self._stamps_ns)
        if count < MIN_RAYS:
            return None
        half = count // 2  # with an odd count the middle ray is in neither half
        first_ns = self._stamps_ns[0]  # a Unix time in ns has more digits than a float
        ages_ns = [stamp_ns - first_ns for stamp_ns in self._stamps_ns]
        span_ns = _median(ages_ns[-half:]) - _median(ages_ns[:half])
        turned = _median(sorted(self._azimuths[-half:])) - _median(sorted(self._azimuths[:half]))
        raised = _median(sorted(self._elevations[-half:])) - _median(sorted(self._elevations[:half]))
        per_s = NS_PER_S / span_ns
        return turned * math.cos(self._elevations[-1]) * per_s, raised * per_s


def _median(ordered: Sequence[float]) -> float:
    middle = len(ordered) // 2
    return ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2.0
