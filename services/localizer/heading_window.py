"""The newest rays of a person, from which a heading is taken."""

import math
from collections import deque

from pointit.geometry import vector
from pointit.schemas import NS_PER_S, PointingRay
from pointit.schemas.text import round_beyond
from pointit.services.localizer.estimation import unfiltered_rays
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.estimation.unfiltered_rays import Mean
from pointit.services.localizer.static_targets import EYES_M

RECENT_NS = NS_PER_S // 2
"""Time over which rays are averaged."""

MAX_RAY_AGE_S = 0.3
"""Largest age of the newest ray."""

MIN_RAYS = 5

MAX_RAYS = 1024
"""Largest number of rays, whatever their rate."""

MAX_SPREAD_RAD = math.radians(2.0)
"""Largest rms by which an arm that is held still may wander."""

MAX_ELEVATION_RAD = math.radians(60.0)
"""Largest elevation at which an arm has a direction."""


class HeadingWindow:
    """Keeps the newest rays."""

    def __init__(self) -> None:
        self._rays: deque[tuple[int, PointingRay]] = deque(maxlen=MAX_RAYS)
        """With their stamps: to read a message costs several times as much as a tuple."""

    def add(self, ray: PointingRay) -> None:
        """Add `ray` unless it is not newer than the last one."""
        rays = self._rays
        stamp_ns = ray.stamp_ns
        if rays and stamp_ns <= rays[-1][0]:
            return
        rays.append((stamp_ns, ray))
        while rays[0][0] < stamp_ns - RECENT_NS:
            rays.popleft()

    @property
    def eyes_m(self) -> float:
        """Return the eye height above the floor by the newest ray."""
        return self._rays[-1][1].origin_m[2] if self._rays else EYES_M

    def mean(self, now_ns: int) -> Mean | Refusal:
        """Return the mean of the newest rays, or a refusal if they have no direction."""
        rays = self._rays
        oldest_ns = now_ns - round(MAX_RAY_AGE_S * NS_PER_S)
        if len(rays) < MIN_RAYS or rays[-1][0] < oldest_ns:
            return Refusal("no rays come; check that the IMU is on and sends, then point and ask again")
        mean = unfiltered_rays.mean([ray for _, ray in rays])

        # Rays that cancel each other have no mean, and no spread that could be stated
        if mean is None or mean.spread_rad > MAX_SPREAD_RAD:
            limit_deg = math.degrees(MAX_SPREAD_RAD)
            wandered = ""
            if mean is not None:
                wandered = f" by {round_beyond(math.degrees(mean.spread_rad), limit_deg)}°"
            return Refusal(
                f"the arm moves{wandered} and at most {limit_deg:.1f}° is accepted; "
                "point at the wall, hold still and ask again"
            )
        elevation_rad = vector.elevation(mean.direction)
        if abs(elevation_rad) > MAX_ELEVATION_RAD:
            return Refusal(
                f"the arm points {math.degrees(elevation_rad):+.0f}° up, too steeply for a direction; "
                "point level at the wall and ask again"
            )
        return mean
