"""Measurement of the sensor's mounting by two poses: the arm level ahead, and straight up.

Orientations are world_from_arm with the mounting before the measurement. The result is arm_from_true, which
rotates vectors of the true arm frame (x to the finger, z up in the first pose) into the previous one.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas.text import round_beyond

Orientations = NDArray[np.float64]
"""n x 4, x, y, z, w."""

MOVEMENT_RAD = math.radians(5.0)
"""Distance from the start of a rest beyond which a sample is a movement; holds wander by 1° (pointing.md
§7)."""
STILL_RAD = math.radians(3.0)
"""Largest spread (rms) of a valid pose."""
APART_RAD = math.radians(45.0)
"""Smallest turn between the two poses, which should be 90°."""
SQUARE_RAD = math.radians(25.0)
"""Largest deviation of the two poses from a right angle; beyond it at least one was held wrongly."""

_UP: Vec3 = (0.0, 0.0, 1.0)


class MountingError(ValueError):
    """The poses do not determine a mounting; the message has the reason and the remedy."""


@dataclass(frozen=True)
class MountingHold:
    """An arm that rested in a pose."""

    mean_xyzw: Quaternion
    spread_rad: float
    """Rms of the angles between the samples and their mean."""
    samples: int


@dataclass(frozen=True)
class FittedMounting:
    """A solved mounting; errors are elevations of the arm minus those of the poses."""

    arm_from_true: Quaternion
    about_arm_rad: float
    """Roll of the sensor about the arm; positive: clockwise, seen from elbow to finger."""
    off_axis_rad: float
    """Angle between the true arm and the previously assumed one."""
    forward_before_rad: float
    up_before_rad: float
    forward_after_rad: float
    up_after_rad: float
    heading_change_rad: float
    """Change of the azimuth of the arm, level ahead, by the new mounting."""


class RestPoseCollector:
    """Collects samples while the arm rests; a movement restarts it."""

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self._samples: list[Quaternion] = []
        self._began_s = 0.0
        self.rested_s = 0.0
        """Duration of the present rest, s."""
        self.moved_rad = 0.0
        """Angle of the newest sample from the start of the rest."""

    def add(self, orientation_xyzw: Quaternion, time_s: float) -> MountingHold | None:
        """Add a sample. Return the pose once the arm has rested long enough, else None."""
        self.moved_rad = 0.0
        if self._samples:
            self.moved_rad = rotation.angle_between(self._samples[0], orientation_xyzw)
        if not self._samples or self.moved_rad > MOVEMENT_RAD or time_s < self._began_s:
            self._samples.clear()
            self._began_s = time_s
        self._samples.append(orientation_xyzw)
        self.rested_s = time_s - self._began_s
        if self.rested_s < self._duration_s:
            return None
        return mean_pose(np.array(self._samples))


def mean_pose(orientations: Orientations) -> MountingHold:
    """Return the mean orientation (Markley 2007, as SciPy has it) and the spread about it."""
    turns = Rotation.from_quat(orientations)
    mean = turns.mean()
    angles = (mean.inv() * turns).magnitude()
    x, y, z, w = (float(value) for value in mean.as_quat())
    spread_rad = float(np.sqrt(np.mean(np.square(angles))))
    return MountingHold((x, y, z, w), spread_rad, len(orientations))


def solve_mounting(forward: MountingHold, up: MountingHold) -> FittedMounting:
    """Return the mounting that explains the arm level ahead (palm down) and the arm straight up.

    The arm's axis pointed up in the second pose and was level in the first; a contradiction is shared between
    both. The roll about it makes the arm's z point up in the first pose.

    Raises:
        MountingError: If the arm did not rest, did not move in between, or one of the poses was another one.
    """
    # Each pose was held still, and the arm moved in between
    for pose, name in ((forward, "ahead"), (up, "up")):
        if pose.spread_rad > STILL_RAD:
            limit_deg = math.degrees(STILL_RAD)
            spread_deg = round_beyond(math.degrees(pose.spread_rad), limit_deg)
            raise MountingError(
                f"the arm did not rest while it was {name}: it wandered by {spread_deg}° rms, at most "
                f"{limit_deg:.0f}° is allowed; hold it still and do it again"
            )
    turn_rad = rotation.angle_between(forward.mean_xyzw, up.mean_xyzw)
    if turn_rad < APART_RAD:
        raise MountingError(
            f"the two poses are the same: between them the arm turned by {math.degrees(turn_rad):.0f}° "
            "only; hold it level ahead first, then straight up"
        )

    # in the previous arm frame: up in the first pose, and the arm's axis, which points up in the second
    level = rotation.rotate(rotation.inverse(forward.mean_xyzw), _UP)
    axis = rotation.rotate(rotation.inverse(up.mean_xyzw), _UP)
    slope = vector.dot(axis, level)
    slope_rad = math.asin(max(-1.0, min(1.0, slope)))
    if abs(slope_rad) > SQUARE_RAD:
        limit_deg = math.degrees(SQUARE_RAD)
        slope_deg = round_beyond(abs(math.degrees(slope_rad)), limit_deg, 0)
        raise MountingError(
            f"up in the second pose is {slope_deg}° from level in the first, at most {limit_deg:.0f}° is "
            "allowed: point level ahead, then straight up, with the arm stretched and the wrist straight, "
            "and without the band slipping"
        )

    # x halves the angle between the axis and its level part; z is at a right angle to it, next to up
    rise = vector.scale(level, vector.dot(axis, level))
    levelled = vector.normalized(vector.subtract(axis, rise))
    x = vector.normalized(vector.add(axis, levelled))
    along_x = vector.scale(x, vector.dot(level, x))
    z = vector.normalized(vector.subtract(level, along_x))
    matrix = np.array([x, vector.cross(z, x), z]).T
    quaternion = Rotation.from_matrix(matrix).as_quat(canonical=True)
    qx, qy, qz, qw = (float(value) for value in quaternion)
    return _report(forward.mean_xyzw, up.mean_xyzw, (qx, qy, qz, qw))


def _report(forward: Quaternion, up: Quaternion, arm_from_true: Quaternion) -> FittedMounting:
    """Return the mounting with the elevations of both poses before and after it."""
    ahead: Vec3 = (1.0, 0.0, 0.0)
    axis = rotation.rotate(arm_from_true, ahead)

    # The arm's axis in both poses, as it was assumed before and as it is
    before = rotation.rotate(forward, ahead)
    after = rotation.rotate(forward, axis)
    up_before = rotation.rotate(up, ahead)
    up_after = rotation.rotate(up, axis)
    half_turn = math.pi / 2.0
    roll_rad = -2.0 * math.atan2(arm_from_true[0], arm_from_true[3])
    return FittedMounting(
        arm_from_true=arm_from_true,
        about_arm_rad=vector.wrap(roll_rad),
        off_axis_rad=vector.angle_between(axis, ahead),
        forward_before_rad=vector.elevation(before),
        up_before_rad=vector.elevation(up_before) - half_turn,
        forward_after_rad=vector.elevation(after),
        up_after_rad=vector.elevation(up_after) - half_turn,
        heading_change_rad=vector.wrap(vector.azimuth(after) - vector.azimuth(before)),
    )
