"""Restores the pose after a restart of the localizer, since a retained pose is lost with its publisher."""

from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import Localization, SetPose, UserPose

OWN_NS = 1_000_000_000
"""Time for a restarted localizer to publish a pose of its own, ns (a fixed one does at once)."""


class PoseRestorer:
    """Keeps the last pose, and returns it when a new localizer needs it.

    A localizer is new if it publishes `idle`, its first state, after the known pose, or if it was away and is
    present again. A pose from an external tracker is restored by the tracker.
    """

    def __init__(self) -> None:
        self._pose: UserPose | None = None
        self._new_ns: int | None = None
        """Time since which there is a localizer without our pose, ns."""
        self._is_away = False
        self._is_sampling = False

    @property
    def deadline_ns(self) -> int | None:
        """Return the time at which to call `due`. None while there is nothing to restore."""
        pose = self._pose
        if pose is None or pose.method == "external":
            return None
        if self._new_ns is None:
            return None
        if self._is_away or self._is_sampling:  # absent, or about to find a better pose
            return None
        return self._new_ns + OWN_NS

    def pose(self, pose: UserPose) -> None:
        """Update the pose. The pose from a new localizer's configuration does not replace a measured one."""
        is_configured = pose.method == "fixed" and not any(pose.covariance)
        is_of_new_localizer = is_configured and self._new_ns is not None
        if is_of_new_localizer and self._has_measured_pose:
            return
        self._pose = pose
        self._new_ns = None
        self._is_away = False

    @property
    def _has_measured_pose(self) -> bool:
        return self._pose is not None and any(self._pose.covariance)

    def localization(self, localization: Localization, now_ns: int) -> None:
        """Process the localizer's progress."""
        self._is_sampling = localization.phase == "sampling"
        pose = self._pose
        if pose is None or localization.phase != "idle":
            return
        was_set_back = pose.stamp_ns > now_ns + MAX_AHEAD_NS  # the clock, so that stamps do not compare
        if localization.stamp_ns > pose.stamp_ns or was_set_back:
            self.renew(now_ns)

    def localizer(self, now_ns: int, *, is_present: bool) -> None:
        """Record the presence of the localizer."""
        if not is_present:
            self._is_away = True
            self._is_sampling = False
        elif self._is_away:
            self._is_away = False
            self.renew(now_ns)

    def due(self, now_ns: int) -> SetPose | None:
        """Return the request that restores the pose, once, if it is due."""
        deadline_ns = self.deadline_ns
        pose = self._pose
        if pose is None or pose.method == "external":
            return None
        if deadline_ns is None or now_ns < deadline_ns:
            return None
        self._new_ns = None
        if not any(pose.covariance):  # exact, as it was set
            return SetPose(
                position_m=pose.position_m, yaw_rad=pose.yaw_rad, remembered_bias=pose.remembered_bias
            )
        return SetPose(
            position_m=pose.position_m,
            yaw_rad=pose.yaw_rad,
            method=pose.method,
            covariance=pose.covariance,
            elevation_bias_rad=pose.elevation_bias_rad,
            remembered_bias=pose.remembered_bias,
        )

    def renew(self, now_ns: int) -> None:
        """Record that the localizer lacks the pose, or did not accept it, so that it becomes due."""
        if self._new_ns is None:
            self._new_ns = now_ns
