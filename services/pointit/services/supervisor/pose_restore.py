"""The person's place outlives the localizer: a pose is a state, and a state dies with its writer."""

from pointit.schemas import Localization, SetPose, UserPose

OWN_NS = 1_000_000_000
"""How long a restarted localizer has to publish a pose of its own (a fixed one does at once)."""


class PoseRestorer:
    """Keeps the last pose, and tells when a localizer that came anew needs it back.

    A localizer is new when it says `idle`, its first word, after the known pose, or when it was away and is
    present again. A pose from an external tracker is the tracker's to keep.
    """

    def __init__(self) -> None:
        self._pose: UserPose | None = None
        self._new_ns: int | None = None
        """Since when there is a localizer without our pose."""
        self._is_away = False
        self._is_sampling = False

    @property
    def deadline_ns(self) -> int | None:
        """Return when `due` must be asked; none while nothing needs to be given back."""
        pose = self._pose
        if pose is None or pose.method == "external" or self._new_ns is None:
            return None
        if self._is_away or self._is_sampling:  # nobody to take it; about to find a better one
            return None
        return self._new_ns + OWN_NS

    def pose(self, pose: UserPose) -> None:
        """Take a pose: whoever published it has it; what a new localizer is configured with is no news."""
        kept = self._pose
        is_configured = pose.method == "fixed" and not any(pose.covariance)
        if self._new_ns is not None and is_configured and kept is not None and any(kept.covariance):
            return
        self._pose = pose
        self._new_ns = None
        self._is_away = False

    def localization(self, news: Localization, now_ns: int) -> None:
        """Take the localizer's progress."""
        self._is_sampling = news.phase == "sampling"
        if news.phase == "idle" and self._pose is not None and news.stamp_ns > self._pose.stamp_ns:
            self._renew(now_ns)

    def localizer(self, now_ns: int, *, is_present: bool) -> None:
        """Take note that the localizer is present, or is not any more."""
        if not is_present:
            self._is_away = True
            self._is_sampling = False
        elif self._is_away:
            self._is_away = False
            self._renew(now_ns)

    def due(self, now_ns: int) -> SetPose | None:
        """Return what the localizer is to be told now, once."""
        deadline_ns = self.deadline_ns
        pose = self._pose
        if pose is None or pose.method == "external" or deadline_ns is None or now_ns < deadline_ns:
            return None
        self._new_ns = None
        if not any(pose.covariance):  # exact, as it was said
            return SetPose(position_m=pose.position_m, yaw_rad=pose.yaw_rad)
        return SetPose(
            position_m=pose.position_m,
            yaw_rad=pose.yaw_rad,
            method=pose.method,
            covariance=pose.covariance,
            elevation_bias_rad=pose.elevation_bias_rad,
        )

    def not_taken(self, now_ns: int) -> None:
        """Take note that the localizer did not take the pose: it will be due again."""
        self._renew(now_ns)

    def _renew(self, now_ns: int) -> None:
        if self._new_ns is None:
            self._new_ns = now_ns
