"""The arm that a mouse moves: the orientation whose pointing ray meets a given point."""

import math

import numpy as np

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, UserProfile
from pointit.sim.aim import Stance
from pointit.sim.tremor import Tremor

FASTEST_RADPS = math.radians(720.0)
"""Maximum angular speed of the arm: a jump of the mouse is followed within a quarter of a second."""

REST_RAD = math.radians(-20.0)
"""Elevation of an arm before the first aim."""


class MouseArm:
    """One person's arm in {H}, which follows a mouse's point in {W}.

    It is the inverse of the pointing service's model. Corrections by that service and the localizer, the
    person's offset and the pose's elevation bias, are not inverted: the user of the mouse sees the cursor and
    corrects it.
    """

    def __init__(self, *, seed: int = 0) -> None:
        """Begin hanging down in front of the body; `seed` is of the tremor."""
        self._profile = UserProfile(stamp_ns=0)
        self._position_m: Vec3 = (0.0, 0.0, 0.0)
        self._yaw_rad = 0.0
        self._tremor = Tremor(0.0, np.random.default_rng(seed))
        self._at_m: Vec3 | None = None
        self._wanted = rotation.from_azimuth_elevation(0.0, REST_RAD)
        self._now = self._wanted
        self._step_ns: int | None = None

    def set_profile(self, profile: UserProfile) -> None:
        """Set the person's body measures, hand and ray model."""
        self._profile = profile
        self._turn()

    def set_pose(self, position_m: Vec3, yaw_rad: float) -> None:
        """Set the person's pose: {H} in {W}, m and rad."""
        if (position_m, yaw_rad) != (self._position_m, self._yaw_rad):
            self._position_m, self._yaw_rad = position_m, yaw_rad
            self._turn()

    def aim(self, at_m: Vec3) -> None:
        """Point at `at_m`, {W}, from now on."""
        self._at_m = at_m
        self._turn()

    def set_tremor(self, rms_rad: float) -> None:
        """Set the tremor about both axes, rad rms each; 0 turns it off."""
        self._tremor.rms_rad = rms_rad

    def azimuth(self, at_m: Vec3) -> float:
        """Return the arm's azimuth in {H}, rad, that points at `at_m`."""
        return self._stance().aim_at(at_m)[0] - self._yaw_rad

    def step(self, now_ns: int) -> Quaternion:
        """Return the arm's orientation in {H} at `now_ns`; its x axis points along the arm to the finger."""
        passed_s = 0.0 if self._step_ns is None else max(0, now_ns - self._step_ns) / NS_PER_S
        if self._step_ns is None:
            self._now = self._wanted  # the first sample may jump
        else:
            self._now = _towards(self._now, self._wanted, FASTEST_RADPS * passed_s)
        self._step_ns = now_ns
        left_rad, up_rad = self._tremor.step(passed_s)
        if left_rad == up_rad == 0.0:
            return self._now
        shaken = rotation.from_azimuth_elevation(left_rad, up_rad)
        return rotation.normalized(rotation.multiply(self._now, shaken))

    def _stance(self) -> Stance:
        profile = self._profile
        return Stance(profile.body, profile.hand, self._position_m, ray_model=profile.ray_model)

    def _turn(self) -> None:
        if self._at_m is not None:
            azimuth, elevation = self._stance().aim_at(self._at_m)
            self._wanted = rotation.from_azimuth_elevation(azimuth - self._yaw_rad, elevation)


def _towards(start: Quaternion, end: Quaternion, most_rad: float) -> Quaternion:
    """Return `start` turned towards `end`, by `most_rad` at most."""
    x, y, z, w = rotation.multiply(rotation.inverse(start), end)
    if w < 0.0:  # the shorter way round
        x, y, z, w = -x, -y, -z, -w
    sine = math.hypot(x, y, z)
    if 2.0 * math.atan2(sine, w) <= most_rad:
        return end
    part = rotation.from_axis_angle((x / sine, y / sine, z / sine), most_rad)
    return rotation.normalized(rotation.multiply(start, part))
