"""One hold: a lamp lights, the person notices, turns to it and settles, and then their rays count.

The first second or so is reaction, and an open-loop reach settles about two seconds after the light
(pointing.md §4): the hold begins when the reaction is over and the ray is steady.
"""

import math
from collections import deque

import numpy as np

from pointit.schemas import NS_PER_S, PointingRay
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation import rays as ray_math

STEADY_S = 0.4
"""Time over which a ray must be steady."""

MIN_RAYS = 4
"""Smallest number of rays in that time."""

MAX_RAYS = 8192
"""Largest number of rays in one hold, whatever their rate."""


class Hold:
    """Rays of one hold; those captured before it only determine its beginning."""

    def __init__(self, lit_ns: int, config: LocalizerConfig) -> None:
        """Create the hold of a lamp that lights at `lit_ns`."""
        self._config = config
        self._from_ns = lit_ns + round(config.reaction_s * NS_PER_S)
        self._latest_ns = self._from_ns + round(config.patience_s * NS_PER_S)
        """Time at which the hold begins even if the ray is not steady."""
        self._newest_ns = -1
        self._recent: deque[PointingRay] = deque()
        """Rays of the last `STEADY_S`, while the ray is not steady."""
        self._waits = config.steady_degps > 0.0
        self.rays: list[PointingRay] = []
        """Rays that count."""

    @property
    def is_settled(self) -> bool:
        """Return True if the ray was steady or need not be."""
        return not self._waits

    def add(self, ray: PointingRay) -> None:
        """Add `ray` unless it is not newer than the last."""
        if ray.stamp_ns <= self._newest_ns:
            return
        self._newest_ns = ray.stamp_ns
        if not self._waits:
            if ray.stamp_ns > self._from_ns and len(self.rays) < MAX_RAYS:
                self.rays.append(ray)
            return
        self._recent.append(ray)
        while self._recent[0].stamp_ns < ray.stamp_ns - round(STEADY_S * NS_PER_S):
            self._recent.popleft()
        if ray.stamp_ns > self._from_ns and (self._is_steady() or ray.stamp_ns >= self._latest_ns):
            self._settle()

    def is_over(self, now_ns: int, enough: int) -> bool:
        """Return True if the hold has lasted long enough and `enough` rays came."""
        return self.is_settled and now_ns >= self._end_ns and len(self.rays) >= enough

    def has_timed_out(self, now_ns: int) -> bool:
        """Return True if waiting for more rays is useless."""
        return now_ns >= self._end_ns + round(self._config.patience_s * NS_PER_S)

    def progress(self, now_ns: int) -> float:
        """Return the progress, 0 to 1."""
        if not self.is_settled:
            return 0.0
        held_s = max(0, now_ns - self._from_ns) / NS_PER_S
        return min(1.0, held_s / self._config.hold_s)

    @property
    def _end_ns(self) -> int:
        return self._from_ns + round(self._config.hold_s * NS_PER_S)

    def _settle(self) -> None:
        self._waits = False
        self._from_ns = max(self._from_ns, self._recent[0].stamp_ns - 1)
        self.rays = [ray for ray in self._recent if ray.stamp_ns > self._from_ns]
        self._recent.clear()

    def _is_steady(self) -> bool:
        """Return True if the mean directions of the two halves of the recent rays are close.

        Halves, because single rays jitter faster than the arm moves.
        """
        recent = self._recent
        span_s = (recent[-1].stamp_ns - recent[0].stamp_ns) / NS_PER_S
        if len(recent) < MIN_RAYS or span_s < 0.75 * STEADY_S:
            return False
        directions = ray_math.directions(recent)
        half = len(recent) // 2
        before, after = directions[:half].sum(axis=0), directions[-half:].sum(axis=0)
        angle_rad = math.atan2(float(np.linalg.norm(np.cross(before, after))), float(before @ after))
        return angle_rad <= math.radians(self._config.steady_degps) * span_s / 2.0
