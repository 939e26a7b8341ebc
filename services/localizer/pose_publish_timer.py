"""Timer of the publications of a pose: again after a noticeable change, or some time."""

import math
from collections.abc import Callable

from pointit.geometry.floor_sigma import position_sigma_m, yaw_sigma_rad
from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import NS_PER_S, UserPose
from pointit.services.localizer.drift.filter import DriftPose

SHORTEST_S = 0.2
"""Shortest time between poses."""

LONGEST_S = 2.0
"""Longest time between poses."""

NOTICEABLE_RAD = math.radians(0.1)
NOTICEABLE_SHARE = 0.05
"""Smallest changes of the yaw, and of a sigma as a share of it, that are published."""


class PosePublishTimer:
    """Stores the last published pose."""

    def __init__(self) -> None:
        self._last: UserPose | None = None
        self._newest_ns = 0
        """Stamp of the newest pose from any source."""

    def heard(self, stamp_ns: int) -> None:
        """Store the stamp of a pose from another source."""
        self._newest_ns = max(self._newest_ns, stamp_ns)

    def stamped(self, pose: UserPose, now_ns: int) -> UserPose:
        """Return `pose` stamped newer than all before, because subscribers use the newest."""
        if self._newest_ns > now_ns + MAX_AHEAD_NS:
            self._newest_ns = 0
        self._newest_ns = max(pose.stamp_ns, self._newest_ns + 1)
        self._last = pose.model_copy(update={"stamp_ns": self._newest_ns})
        return self._last

    def is_due(self, now: DriftPose) -> bool:
        """Return True if the current pose is to be published."""
        last = self._last
        if last is None:
            return True
        passed_s = (now.stamp_ns - last.stamp_ns) / NS_PER_S
        if passed_s >= LONGEST_S:
            return True
        return passed_s >= SHORTEST_S and _has_changed(last, now)

    def wait_s(self, now_ns: int, at: Callable[[int], DriftPose]) -> float:
        """Return the time until the pose may be due, s; `at` returns the pose at a time."""
        last = self._last
        if last is not None:
            for wait_s in (SHORTEST_S, 0.5, 1.0):
                then_ns = now_ns + round(wait_s * NS_PER_S)
                if _has_changed(last, at(then_ns)):
                    return wait_s
        return LONGEST_S


def _has_changed(last: UserPose, now: DriftPose) -> bool:
    """Return True if the yaw or a sigma differs noticeably from the published one."""
    turn_rad = math.remainder(now.yaw_rad - last.yaw_rad, math.tau)
    if abs(turn_rad) >= NOTICEABLE_RAD:
        return True
    last_yaw_sigma = yaw_sigma_rad(last.covariance)
    if abs(now.yaw_sigma_rad - last_yaw_sigma) > NOTICEABLE_SHARE * last_yaw_sigma:
        return True
    last_position_sigma = position_sigma_m(last.covariance)
    return abs(now.position_sigma_m - last_position_sigma) > NOTICEABLE_SHARE * last_position_sigma
