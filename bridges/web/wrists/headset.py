"""A headset as a wrist: the pose of its wearer, and the point that the arm points at, in {W}. Pure.

The wearer points as with every wrist: along the line from the eyes over the fingertip. A headset measures
both, so the arm is that for which the pointing model has this line, whatever the length of the wearer's arm.
"""

import math
from dataclasses import dataclass

from pointit.bridges.web.wire import HeadsetMotion, SpaceAlignment
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas import NS_PER_S, UserPose

MIN_REACH_M = 0.1
"""Least distance of a pointing hand from the eyes."""
MAX_REACH_M = 1.5
"""Largest distance of a pointing hand. A controller beyond both lies somewhere: the arm hangs."""
HEADSET_TIMEOUT_S = 5.0
"""Silence after which a headset has released the wrist, s: it draws few frames while it is busy."""
MAX_AWAY_M = 1000.0
"""Maximum distance of the wearer from the origin of the map, m."""
TARGET_M = 3.0
"""Distance of the aimed-at point from the eyes. It matters to ray models that do not begin at the eyes."""
MOVED_M = 0.01
"""Distance at which a pose is published again."""
POSE_NS = NS_PER_S // 10
"""Least time between two poses, ns."""
MAX_POSE_NS = NS_PER_S // 2
"""Greatest time between two poses, ns."""
POSITION_SIGMA_M = 0.02
YAW_SIGMA_RAD = math.radians(0.3)
"""1 sigma of an alignment by three touches (docs/how-to/headset.md)."""
COVARIANCE = (
    *(POSITION_SIGMA_M**2, 0.0, 0.0),
    *(0.0, POSITION_SIGMA_M**2, 0.0),
    *(0.0, 0.0, YAW_SIGMA_RAD**2),
)
"""Covariance of x, y (m) and yaw (rad), a row a line."""


@dataclass(slots=True)
class HeadsetPose:
    """Pose of one wearer. Times are the site's, ns."""

    yaw_rad: float = 0.0
    """Azimuth of {H}'s x axis in {W}, which stays the same while the headset is worn."""
    feet_m: Vec3 = (0.0, 0.0, 0.0)
    """Below the eyes by the person's measures, so that the ray begins at the wearer's eyes."""
    target_m: Vec3 = (0.0, 0.0, 0.0)
    """Point on the line from the eyes over the tip, or the feet if the hand does not point."""
    _received_ns: int = 0
    _published_ns: int = 0
    _published_m: Vec3 = (0.0, 0.0, 0.0)

    def update(self, motion: HeadsetMotion, eyes_height_m: float, now_ns: int) -> UserPose | None:
        """Update from head and hand. Return the pose if it is to be published, else None.

        Raises:
            RefusedError: If the headset is not aligned, or is too far from the map.
        """
        if motion.alignment is None:
            raise RefusedError("the headset is not aligned with the room: touch three lamps or things first")
        eyes_m = _in_room(motion.alignment, motion.eyes_m)
        away_m = vector.norm(eyes_m)
        if away_m > MAX_AWAY_M:
            raise RefusedError(
                f"the headset is {away_m:.0f} m from the map, limit {MAX_AWAY_M:.0f} m: align it again"
            )
        self._received_ns = now_ns
        self.feet_m = vector.subtract(eyes_m, (0.0, 0.0, eyes_height_m))
        # The arm hangs down unless the hand points
        self.target_m = self.feet_m
        if motion.tip_m is not None:
            reach = vector.subtract(_in_room(motion.alignment, motion.tip_m), eyes_m)
            reach_m = vector.norm(reach)
            if MIN_REACH_M <= reach_m <= MAX_REACH_M:
                self.target_m = vector.add(eyes_m, vector.scale(reach, TARGET_M / reach_m))

        # A wearer who stands still has a pose now and then, too
        age_ns = now_ns - self._published_ns
        has_moved = math.dist(self.feet_m, self._published_m) > MOVED_M
        period_ns = POSE_NS if has_moved else MAX_POSE_NS
        if 0 <= age_ns < period_ns:  # below 0: the clock was set back
            return None
        self._published_ns = now_ns
        self._published_m = self.feet_m
        return UserPose(
            stamp_ns=now_ns,
            position_m=self.feet_m,
            yaw_rad=self.yaw_rad,
            covariance=COVARIANCE,
            method="external",
        )

    def last_received_ns(self, now_ns: int) -> int:
        """Return the time of the last update, or of the first call before it: a page takes, then sends."""
        self._received_ns = self._received_ns or now_ns
        return self._received_ns


def _in_room(alignment: SpaceAlignment, at_m: Vec3) -> Vec3:
    return vector.add(vector.rotate_z(at_m, alignment.yaw_rad), alignment.origin_m)
