"""True pose of a person by motion capture, and the error of a localized pose. Pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, TrackedObject, TrackedObjects, UserPose

PERSON = "person"
"""Kind of the object of a person whose yaw is not known, or where they face."""
PERSON_FRAME = "person_frame"
"""Kind of the object of a person whose `yaw_rad` is that of {H}."""
MAX_APART_NS = NS_PER_S // 2
"""Largest time by which a pose may be later than the true one with which it is compared, ns."""


@dataclass(frozen=True, slots=True)
class PoseError:
    """Difference of a localized pose from the true one."""

    position_m: float
    """Level distance, m."""
    yaw_rad: float | None
    """Localized less true yaw, -π to π, or None if the true one is not known."""


@dataclass(frozen=True, slots=True)
class TruePose:
    """Pose of a person as a tracker sees it."""

    stamp_ns: int
    position_m: Vec3
    """Position in {W}, of the head if the tracker sees that."""
    yaw_rad: float | None
    """Azimuth of {H}'s x axis in {W}, or None if it is not known."""

    @classmethod
    def from_object(cls, tracked: TrackedObject, stamp_ns: int) -> "TruePose":
        """Return the pose of a person by their object at `stamp_ns`."""
        is_frame = tracked.kind == PERSON_FRAME
        return cls(stamp_ns, tracked.position_m, tracked.yaw_rad if is_frame else None)

    def error_of(self, pose: UserPose) -> PoseError | None:
        """Return the error of `pose`, which stays in force until the next one.

        Returns None if it was not localized, or is later than the true pose.
        """
        if pose.method == "external" or pose.stamp_ns - self.stamp_ns > MAX_APART_NS:
            return None
        away_m = math.dist(self.position_m[:2], pose.position_m[:2])
        if self.yaw_rad is None:
            return PoseError(away_m, None)
        return PoseError(away_m, math.remainder(pose.yaw_rad - self.yaw_rad, math.tau))


def find_true_poses(messages: Mapping[str, TrackedObjects]) -> dict[str, TruePose]:
    """Return the true poses by person, from the newest message of each tracker. A known yaw wins."""
    poses: dict[str, TruePose] = {}
    for message in messages.values():
        for tracked in message.objects:
            is_first = tracked.kind == PERSON and tracked.id not in poses
            if tracked.kind == PERSON_FRAME or is_first:
                poses[tracked.id] = TruePose.from_object(tracked, message.stamp_ns)
    return poses
