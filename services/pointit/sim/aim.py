"""Where the arm must point so that the line from the eyes over the finger meets a point."""

import math
from dataclasses import dataclass
from typing import Literal

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures

RayModel = Literal["eye_finger", "shoulder_arm", "forearm"]

UPPER_ARM_SHARE = 0.56
"""Of the length from shoulder to wrist (Drillis and Contini 1966)."""


@dataclass(frozen=True, slots=True)
class Aim:
    """An orientation of the arm in {W} and how it turns, rad and rad/s."""

    azimuth_rad: float
    elevation_rad: float
    azimuth_rate_radps: float = 0.0
    elevation_rate_radps: float = 0.0


class Stance:
    """A body at its place: eyes, shoulder and arm's length in {W}."""

    def __init__(
        self,
        body: BodyMeasures,
        hand: str = "right",
        position_m: Vec3 = (0.0, 0.0, 0.0),
        yaw_rad: float = 0.0,
        *,
        ray_model: RayModel = "eye_finger",
    ) -> None:
        """Stand at `position_m`, {H} turned by `yaw_rad`; the shoulder lies in {H} as the model has it.

        `ray_model`: aim with the finger before the eyes, with the straight arm, or with the forearm alone.
        """
        side = 1.0 if hand == "left" else -1.0
        shoulder = (0.0, side * body.neck_to_shoulder_m, body.footprint_to_neck_m)
        self._up_m: Vec3 = (0.0, 0.0, body.footprint_to_neck_m + body.neck_to_eyes_m)
        self._to_shoulder_m = vector.turn(shoulder, yaw_rad)
        hang_m = UPPER_ARM_SHARE * body.shoulder_to_wrist_m if ray_model == "forearm" else 0.0
        self._to_start_m = self._up_m
        if ray_model != "eye_finger":
            self._to_start_m = vector.subtract(self._to_shoulder_m, (0.0, 0.0, hang_m))
        self._by_arm = ray_model != "eye_finger"
        self.arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
        self.move(position_m)

    def move(self, position_m: Vec3) -> None:
        """Stand at `position_m` from now on."""
        self.position_m = position_m
        self.start_m: Vec3 = vector.add(position_m, self._to_start_m)
        """Where the line begins that the person brings onto things: eyes, shoulder or elbow."""
        self.eyes_m: Vec3 = vector.add(position_m, self._up_m)
        self.shoulder_m: Vec3 = vector.add(position_m, self._to_shoulder_m)

    def aim_at(self, point_m: Vec3, beside: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
        """Return the arm's azimuth and elevation, rad, that point at `point_m`.

        `beside`, azimuth and elevation, rad, is how far the line that they bring onto it passes beside it.
        """
        sight = vector.subtract(point_m, self.start_m)
        azimuth, elevation = vector.azimuth(sight) + beside[0], vector.elevation(sight) + beside[1]
        return (azimuth, elevation) if self._by_arm else self._finger_on(vector.direction(azimuth, elevation))

    def _finger_on(self, along: Vec3) -> tuple[float, float]:
        """Return the arm's azimuth and elevation, rad, that put the finger on the line from the eyes `along`.

        The finger is where that line leaves the sphere about the shoulder; when the arm is too short to
        reach the line, it points at the line's nearest point.
        """
        to_shoulder = vector.subtract(self.shoulder_m, self.eyes_m)
        half_m = vector.dot(along, to_shoulder)
        rest = half_m**2 - vector.dot(to_shoulder, to_shoulder) + self.arm_m**2
        finger_at_m = max(half_m + math.sqrt(max(rest, 0.0)), 0.0)
        arm = vector.subtract(vector.scale(along, finger_at_m), to_shoulder)
        return (vector.azimuth(arm), vector.elevation(arm))

    def sight_of(self, point_m: Vec3) -> tuple[float, float]:
        """Return azimuth and elevation, rad, at which the eyes see `point_m`."""
        sight = vector.subtract(point_m, self.eyes_m)
        return (vector.azimuth(sight), vector.elevation(sight))
