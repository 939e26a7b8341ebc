"""Poses of an external tracker, which have priority over the localizer."""

from pointit.schemas import NS_PER_S, UserPose

FRESH_S = 2.0
"""Age up to which the tracker's last pose is valid."""


class ExternalPose:
    """Last pose of an external tracker and the time of its arrival."""

    def __init__(self) -> None:
        self.pose: UserPose | None = None
        """The last one. None before the first, or after the localizer was asked to take over."""
        self._received_ns = 0

    def hear(self, pose: UserPose, now_ns: int) -> bool:
        """Store a tracker's pose. Return True if it is the first, also after `take_over`."""
        is_first = self.pose is None
        self.pose, self._received_ns = pose, now_ns
        return is_first

    def take_over(self) -> None:
        """Discard the tracker's pose so that the localizer publishes again."""
        self.pose = None

    def age_s(self, now_ns: int) -> float:
        """Return the age of the tracker's pose, s, by its arrival on this machine's clock."""
        return (now_ns - self._received_ns) / NS_PER_S

    def is_fresh(self, now_ns: int) -> bool:
        """Return True if the tracker currently provides the pose."""
        return self.pose is not None and self.age_s(now_ns) <= FRESH_S

    def busy_reason(self, user: str, now_ns: int) -> str:
        """Return the reason why the localizer is inactive, or `""` if it may act."""
        if not self.is_fresh(now_ns):
            return ""
        return (
            f"a tracker provides the pose of {user}, last {self.age_s(now_ns):.1f} s ago; stop the "
            "tracker before asking the localizer"
        )
