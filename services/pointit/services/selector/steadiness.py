"""How fast a ray turns: a robust estimate over a fraction of a second."""

import math
from collections import deque

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S

FEWEST = 2
"""Rays without which there is no speed."""


class Steadiness:
    """Keeps the last directions of one person's ray and says how fast it turns.

    The window is cut in the middle; the speed is the way from the median direction of its older half to
    that of its newer half, over the time between their means. A single wrong sample changes a median
    little, and tremor of 6 to 12 Hz, whose momentary speed is as high as that of slow pointing, is
    levelled out.
    """

    def __init__(self, window_s: float) -> None:
        self._window_ns = round(window_s * NS_PER_S)
        self._rays: deque[tuple[int, float, float]] = deque()
        """Stamp, azimuth (without jumps at half a turn) and elevation."""

    def clear(self) -> None:
        """Forget all rays."""
        self._rays.clear()

    def add(self, stamp_ns: int, direction: Vec3) -> None:
        """Take the ray of `stamp_ns`, later than those before, with its unit direction in {W}."""
        rays = self._rays
        azimuth = vector.azimuth(direction)
        if rays:
            azimuth = rays[-1][1] + vector.wrap(azimuth - rays[-1][1])
        rays.append((stamp_ns, azimuth, vector.elevation(direction)))
        oldest_ns = stamp_ns - self._window_ns
        while len(rays) > FEWEST and rays[0][0] < oldest_ns:
            rays.popleft()

    def rate(self) -> tuple[float, float] | None:
        """Return the speed towards greater azimuth (on the sphere) and up, rad/s; none: not known yet."""
        rays = self._rays
        if len(rays) < FEWEST:
            return None
        middle_ns = (rays[0][0] + rays[-1][0]) // 2
        older = [ray for ray in rays if ray[0] <= middle_ns]
        newer = [ray for ray in rays if ray[0] > middle_ns]
        base_ns = rays[0][0]
        span_s = (
            sum(ray[0] - base_ns for ray in newer) / len(newer)
            - sum(ray[0] - base_ns for ray in older) / len(older)
        ) / NS_PER_S
        turned = _median([ray[1] for ray in newer]) - _median([ray[1] for ray in older])
        raised = _median([ray[2] for ray in newer]) - _median([ray[2] for ray in older])
        return turned * math.cos(rays[-1][2]) / span_s, raised / span_s


def _median(values: list[float]) -> float:
    values.sort()
    half = len(values) // 2
    return values[half] if len(values) % 2 else (values[half - 1] + values[half]) / 2.0
