"""Poses of a tracker outside: whoever knows better where the person stands is let do it."""

from pointit.schemas import NS_PER_S, UserPose
from pointit.services.localizer.procedures.clock_step import BACK_NS

FRESH_S = 2.0
"""A tracker that was heard no longer ago than this gives the pose."""


class ExternalPose:
    """What an external tracker says of the person, and when it came here."""

    def __init__(self) -> None:
        self.pose: UserPose | None = None
        """The last one; none when there was none, or the localizer was asked to take over."""
        self._heard_ns = 0

    def hear(self, pose: UserPose, now_ns: int) -> bool:
        """Take a tracker's pose. Return True if the localizer gives the pose until now."""
        is_first = self.pose is None
        self.pose, self._heard_ns = pose, now_ns
        return is_first

    def take_over(self) -> None:
        """Let the localizer give the pose again."""
        self.pose = None

    def age_s(self, now_ns: int) -> float:
        """Return how long ago the tracker was heard, s; by arrival, whatever its clock says.

        After this machine's clock was set back nobody knows: from then on it counts from just too long.
        """
        if now_ns < self._heard_ns - BACK_NS:
            self._heard_ns = now_ns - round(FRESH_S * NS_PER_S) - 1
        return max(0, now_ns - self._heard_ns) / NS_PER_S

    def is_fresh(self, now_ns: int) -> bool:
        """Return True if the tracker gives the pose."""
        return self.pose is not None and self.age_s(now_ns) <= FRESH_S

    def busy_reason(self, user: str, now_ns: int) -> str:
        """Return why the localizer does not do anything; empty when it may."""
        if not self.is_fresh(now_ns):
            return ""
        return (
            f"a tracker gives the pose of {user}, {self.age_s(now_ns):.1f} s ago for the last time; stop the "
            "tracker before asking the localizer"
        )


def external_pose_message(user: str) -> str:
    """Return why the localizer has stopped."""
    return (
        f"a tracker gives the pose of {user} now and the localizer stands back; stop the tracker to localize"
    )
