"""Direction of the arm whose line from the eyes over the finger meets a point, and the hand's tremor."""

import math
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures
from pointit.schemas.person import RayModel

TREMOR_HZ = (6.0, 12.0)
TREMOR_TONES = 3
UPPER_ARM_SHARE = 0.56
"""Upper arm as a share of the length from shoulder to wrist (Drillis and Contini 1966)."""


class Tremor:
    """Two angles that tremble about 0, each of the same rms."""

    def __init__(self, rms_rad: float, rng: np.random.Generator) -> None:
        shape = (2, TREMOR_TONES)
        tones_hz = rng.uniform(*TREMOR_HZ, shape)
        self._tone_radps = (math.tau * tones_hz).tolist()
        self._phase_rad = rng.uniform(0.0, math.tau, shape).tolist()
        self.rms_rad = rms_rad
        """Rms of each axis; may be set at any time."""

    def step(self, passed_s: float) -> tuple[float, float]:
        """Return both angles `passed_s` after the last step, rad."""
        if self.rms_rad == 0.0:
            return (0.0, 0.0)
        tone_rad = self.rms_rad * math.sqrt(2.0 / TREMOR_TONES)
        angles = [0.0, 0.0]
        for axis in (0, 1):
            tones = zip(self._phase_rad[axis], self._tone_radps[axis], strict=True)
            phases = [(phase + rate * passed_s) % math.tau for phase, rate in tones]
            self._phase_rad[axis] = phases
            angles[axis] = tone_rad * math.fsum(map(math.sin, phases))
        return (angles[0], angles[1])


@dataclass(frozen=True, slots=True)
class Aim:
    """An orientation of the arm in {W} and its rates, rad and rad/s."""

    azimuth_rad: float
    elevation_rad: float
    azimuth_rate_radps: float = 0.0
    elevation_rate_radps: float = 0.0


class Stance:
    """A body at its position: eyes, shoulder and arm's length in {W}. It faces where the arm points."""

    def __init__(
        self,
        body: BodyMeasures,
        hand: str = "right",
        position_m: Vec3 = (0.0, 0.0, 0.0),
        *,
        ray_model: RayModel = "eye_finger",
    ) -> None:
        """Place the body at `position_m`; `ray_model` is the way of aiming, as in `UserProfile`."""
        self._side_m = body.neck_to_shoulder_m if hand == "left" else -body.neck_to_shoulder_m
        self._neck_m = body.footprint_to_neck_m
        self._drop_m = body.neck_to_eyes_m
        self._hang_m = UPPER_ARM_SHARE * body.shoulder_to_wrist_m if ray_model == "forearm" else 0.0
        self._by_arm = ray_model != "eye_finger"
        self.arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
        self.move(position_m)

    def move(self, position_m: Vec3) -> None:
        """Move the body to `position_m`."""
        self.position_m = position_m
        height_m = self._neck_m + self._drop_m
        self.eyes_m: Vec3 = vector.add(position_m, (0.0, 0.0, height_m))

    def shoulder_m(self, azimuth_rad: float) -> Vec3:
        """Return the position of the shoulder, {W}, of an arm of that azimuth."""
        offset_m = vector.rotate_z((0.0, self._side_m, self._neck_m), azimuth_rad)
        return vector.add(self.position_m, offset_m)

    def aim_at(self, point_m: Vec3, beside: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
        """Return the arm's azimuth and elevation, rad, that point at `point_m`.

        `beside` is the error of the line, azimuth and elevation, rad.
        """
        # By eye and finger
        if not self._by_arm:
            sight = vector.subtract(point_m, self.eyes_m)
            azimuth = vector.azimuth(sight) + beside[0]
            elevation = vector.elevation(sight) + beside[1]
            return self._finger_on(azimuth, elevation)

        # By the arm, whose shoulder, or elbow, is beside the neck
        sight = vector.subtract(point_m, self.position_m)
        level_m = math.hypot(sight[0], sight[1])
        up_m = sight[2] - self._neck_m + self._hang_m
        azimuth = vector.azimuth(sight) - _turn(self._side_m, level_m)
        ahead_m = math.sqrt(max(level_m**2 - self._side_m**2, 0.0))
        elevation = math.atan2(up_m, ahead_m)
        return azimuth + beside[0], elevation + beside[1]

    def _finger_on(self, azimuth_rad: float, elevation_rad: float) -> tuple[float, float]:
        """Return the arm's azimuth and elevation, rad, that put the finger on that line from the eyes.

        If the arm cannot reach the line, it points at the line's nearest point.
        """
        up = math.sin(elevation_rad)
        level = math.cos(elevation_rad)
        # intersection of the line with the places that the finger of an arm beside the neck can reach
        up_drop_m = self._drop_m * up
        rest = up_drop_m**2 - self._drop_m**2 + self._side_m**2 + self.arm_m**2
        finger_at_m = max(math.sqrt(max(rest, 0.0)) - up_drop_m, 0.0)
        level_m = finger_at_m * level
        ahead_m = math.sqrt(max(level_m**2 - self._side_m**2, 0.0))
        azimuth = azimuth_rad - _turn(self._side_m, level_m)
        finger_up_m = finger_at_m * up + self._drop_m
        return azimuth, math.atan2(finger_up_m, ahead_m)

    def sight_of(self, point_m: Vec3) -> tuple[float, float]:
        """Return azimuth and elevation, rad, of `point_m` from the eyes."""
        sight = vector.subtract(point_m, self.eyes_m)
        return (vector.azimuth(sight), vector.elevation(sight))


def _turn(side_m: float, level_m: float) -> float:
    """Return the azimuth, relative to the arm's, of a place on its line `level_m` from the neck."""
    if not level_m > 0.0:
        return 0.0
    sine = side_m / level_m
    return math.asin(max(-1.0, min(1.0, sine)))
