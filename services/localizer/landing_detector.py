"""The first landing of a reach: the ray rests after it has moved."""

import math
from collections import deque
from dataclasses import replace

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, PointingRay
from pointit.services.localizer.estimation.unfiltered_rays import Mean, mean, unfiltered

SIGMA_RAD = math.radians(5.0)
"""Standard deviation of a landing sideways (pointing.md §3)."""
MOVING_RADPS, RESTING_RADPS = math.radians(20.0), math.radians(8.0)
"""Speeds above which the arm reaches, and below which it has landed, rad/s."""
WINDOW_NS = NS_PER_S // 10
"""Time over which the speed is measured, and the landing is averaged, ns."""
CORRECTION_NS = 5 * NS_PER_S // 2
"""Maximum time between landings of one reach, ns: a name that is spoken again is understood after 2.3 s."""


class LandingDetector:
    """First landing of the present reach."""

    def __init__(self) -> None:
        self._recent: deque[tuple[int, Vec3, PointingRay]] = deque(maxlen=256)
        """Stamp, unfiltered direction and ray: each is read from the ray once, which costs most of `add`."""
        self._is_moving = False
        self._landing_mean: Mean | None = None
        self._landed_ns = 0

    def add(self, ray: PointingRay) -> None:
        """Process a ray."""
        recent = self._recent
        stamp_ns = ray.stamp_ns
        direction = unfiltered(ray)
        if recent and not 0 < stamp_ns - recent[-1][0] <= 3 * WINDOW_NS:
            recent.clear()
        recent.append((stamp_ns, direction, ray))
        first_ns, first, _ = recent[0]
        if (passed_ns := stamp_ns - first_ns) < WINDOW_NS:
            return
        speed_radps = vector.angle_between(first, direction) * NS_PER_S / passed_ns
        is_landing = self._is_moving and speed_radps < RESTING_RADPS
        if is_landing and (landing := mean([each for _, _, each in recent])) is not None:
            if self._landing_mean is None or not 0 <= stamp_ns - self._landed_ns <= CORRECTION_NS:
                self._landing_mean = replace(landing, sigma_rad=SIGMA_RAD)
            self._landed_ns = stamp_ns
        self._is_moving = speed_radps > MOVING_RADPS or (self._is_moving and speed_radps >= RESTING_RADPS)
        while stamp_ns - recent[0][0] >= WINDOW_NS:
            recent.popleft()

    def take(self) -> Mean | None:
        """Return the mean of the rays at the first landing of the reach, once. None if there is none."""
        landing_mean = self._landing_mean
        self._landing_mean = None
        return landing_mean
