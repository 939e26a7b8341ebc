"""Where the arm must point so that the line from the eyes over the finger meets a point."""

import math
from dataclasses import dataclass

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures


@dataclass(frozen=True, slots=True)
class Aim:
    """An orientation of the arm in {W} and how it turns, rad and rad/s."""

    azimuth_rad: float
    elevation_rad: float
    azimuth_rate_radps: float = 0.0
    elevation_rate_radps: float = 0.0

    def turned(self, azimuth_rad: float, elevation_rad: float) -> "Aim":
        """Return the aim beside this one."""
        return Aim(
            self.azimuth_rad + azimuth_rad,
            self.elevation_rad + elevation_rad,
            self.azimuth_rate_radps,
            self.elevation_rate_radps,
        )


class Stance:
    """A body at its place: eyes, shoulder and arm's length in {W}."""

    def __init__(
        self,
        body: BodyMeasures,
        hand: str = "right",
        position_m: Vec3 = (0.0, 0.0, 0.0),
        yaw_rad: float = 0.0,
    ) -> None:
        """Stand at `position_m`, {H} turned by `yaw_rad`; the shoulder lies in {H} as the model has it."""
        side = 1.0 if hand == "left" else -1.0
        shoulder = (0.0, side * body.neck_to_shoulder_m, body.footprint_to_neck_m)
        self.eyes_m: Vec3 = vector.add(position_m, (0.0, 0.0, body.footprint_to_neck_m + body.neck_to_eyes_m))
        self.shoulder_m: Vec3 = vector.add(position_m, vector.turn(shoulder, yaw_rad))
        self.arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m

    def aim_at(self, point_m: Vec3) -> tuple[float, float]:
        """Return the arm's azimuth and elevation, rad, that put the finger between the eyes and `point_m`.

        The finger is where that line leaves the sphere about the shoulder; when the arm is too short to
        reach the line, it points at the line's nearest point.
        """
        sight = vector.subtract(point_m, self.eyes_m)
        distance_m = vector.norm(sight)
        if distance_m < 1e-9:  # the eyes themselves: any direction will do
            return (0.0, 0.0)
        along = vector.scale(sight, 1.0 / distance_m)
        to_shoulder = vector.subtract(self.shoulder_m, self.eyes_m)
        half_m = vector.dot(along, to_shoulder)
        rest = half_m**2 - vector.dot(to_shoulder, to_shoulder) + self.arm_m**2
        finger_at_m = max(half_m + math.sqrt(max(rest, 0.0)), 0.0)
        finger = vector.add(self.eyes_m, vector.scale(along, finger_at_m))
        arm = vector.subtract(finger, self.shoulder_m)
        return (vector.azimuth(arm), vector.elevation(arm))

    def sight_of(self, point_m: Vec3) -> tuple[float, float]:
        """Return azimuth and elevation, rad, at which the eyes see `point_m`."""
        sight = vector.subtract(point_m, self.eyes_m)
        return (vector.azimuth(sight), vector.elevation(sight))
