"""Landing of a reach: the first rest of the ray after the arm has moved.

People reach quickly, rest, and then correct where they point in small steps, misled by light or a name that
is spoken. Only the first rest shows where they see the target.
"""

import math
from collections import deque
from dataclasses import replace

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, PointingRay
from pointit.services.localizer.estimation.unfiltered_rays import Mean, mean, unfiltered

SIGMA_RAD = math.radians(5.0)
"""Standard deviation of a landing sideways (pointing.md §3)."""
MOVING_RADPS = math.radians(20.0)
"""Speed above which the arm reaches or corrects, rad/s."""
RESTING_RADPS = math.radians(8.0)
"""Speed below which it rests again, rad/s."""
WINDOW_NS = NS_PER_S // 10
"""Time over which the speed is measured, and the landing is averaged, ns."""
CORRECTION_NS = 5 * NS_PER_S // 2
"""Maximum time between rests of one reach, ns: a name that is spoken again is understood after 2.3 s."""


class LandingDetector:
    """Landing of the present reach, from its rays."""

    def __init__(self) -> None:
        self._recent: deque[tuple[int, Vec3, PointingRay]] = deque(maxlen=256)
        """Stamp, unfiltered direction and ray: each is read from the ray once, which costs most of `add`."""
        self._is_moving = False
        self._landing_mean: Mean | None = None
        self._rested_ns = 0
        """Time of the last rest, ns."""

    def add(self, ray: PointingRay) -> None:
        """Process a ray."""
        recent = self._recent
        stamp_ns = ray.stamp_ns
        direction = unfiltered(ray)

        # the speed over the window; after a gap, or if the clock was set, it starts again
        if recent and not 0 < stamp_ns - recent[-1][0] <= 3 * WINDOW_NS:
            recent.clear()
        recent.append((stamp_ns, direction, ray))
        first_ns, first, _ = recent[0]
        passed_ns = stamp_ns - first_ns
        if passed_ns < WINDOW_NS:
            return
        speed_radps = vector.angle_between(first, direction) * NS_PER_S / passed_ns

        was_moving = self._is_moving
        self._is_moving = self._moves_at(speed_radps)
        if was_moving and not self._is_moving:
            self._on_rest(stamp_ns)
        while stamp_ns - recent[0][0] >= WINDOW_NS:
            recent.popleft()

    def pop_landing(self) -> Mean | None:
        """Return the mean of the rays at the landing of the reach, once. None if there is none."""
        landing_mean = self._landing_mean
        self._landing_mean = None
        return landing_mean

    def _moves_at(self, speed_radps: float) -> bool:
        """Return True if the arm moves at this speed: it starts and ends at different ones."""
        if self._is_moving:
            return speed_radps >= RESTING_RADPS
        return speed_radps > MOVING_RADPS

    def _on_rest(self, stamp_ns: int) -> None:
        """Store a rest as the landing if it is the first of its reach."""
        rest_mean = mean([ray for _, _, ray in self._recent])
        if rest_mean is None:
            return
        if self._landing_mean is None or self._is_new_reach(stamp_ns):
            self._landing_mean = replace(rest_mean, sigma_rad=SIGMA_RAD)
        self._rested_ns = stamp_ns

    def _is_new_reach(self, stamp_ns: int) -> bool:
        """Return True if a rest now ends another reach, rather than a correction of the present one."""
        return not 0 <= stamp_ns - self._rested_ns <= CORRECTION_NS
