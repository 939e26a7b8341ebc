"""Landings of the arm, before a name or a light corrects it. A confirmed selection shows what they meant."""

import math
from collections import deque
from dataclasses import replace

from pointit.geometry import vector
from pointit.schemas import NS_PER_S, PointingRay
from pointit.services.localizer.estimation.rays import Mean, mean, unfiltered

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
        self._rays: deque[PointingRay] = deque(maxlen=256)
        self._is_moving = False
        self._landing_mean: Mean | None = None
        self._landed_ns = 0

    def add(self, ray: PointingRay) -> None:
        """Process a ray."""
        rays, stamp_ns = self._rays, ray.stamp_ns
        if rays and not 0 < stamp_ns - rays[-1].stamp_ns <= 3 * WINDOW_NS:
            rays.clear()
        rays.append(ray)
        if (passed_ns := stamp_ns - rays[0].stamp_ns) < WINDOW_NS:
            return
        speed_radps = vector.angle_between(unfiltered(rays[0]), unfiltered(ray)) * NS_PER_S / passed_ns
        if self._is_moving and speed_radps < RESTING_RADPS and (landing := mean(list(rays))) is not None:
            if self._landing_mean is None or not 0 <= stamp_ns - self._landed_ns <= CORRECTION_NS:
                self._landing_mean = replace(landing, sigma_rad=SIGMA_RAD)
            self._landed_ns = stamp_ns
        self._is_moving = speed_radps > MOVING_RADPS or (self._is_moving and speed_radps >= RESTING_RADPS)
        while stamp_ns - rays[0].stamp_ns >= WINDOW_NS:
            rays.popleft()

    def take(self) -> Mean | None:
        """Return the mean of the rays at the first landing of the reach, once. None if there is none."""
        landing_mean, self._landing_mean = self._landing_mean, None
        return landing_mean
