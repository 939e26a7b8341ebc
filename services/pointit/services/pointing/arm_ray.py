"""The pointing ray of an arm in {H}: eye-finger, shoulder-arm or forearm (paper, §II-A; pointing.md §1).

In all three the ray starts at a place of the body that does not move, and goes along a fixed vector plus the
arm's own: for the eye-finger ray that is from the eyes to the shoulder and on along the straight arm.
"""

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures, UserProfile

Array = NDArray[np.float64]
RayModel = Literal["eye_finger", "shoulder_arm", "forearm"]

UPPER_ARM_SHARE = 0.56
"""Of the length from shoulder to wrist: 0.186 and 0.146 of the stature (Drillis and Contini 1966)."""

NEAREST_M = 1e-6
"""A fingertip nearer to the eyes gives no direction."""


class ArmRay:
    """One person's ray as a function of the orientation of their arm.

    The eye-finger and the shoulder-arm ray take the arm to be straight. The forearm ray takes the upper arm
    to hang and starts at the elbow below the shoulder: with a straight arm its line would be the shoulder-arm
    ray's own.
    """

    def __init__(
        self,
        body: BodyMeasures | None = None,
        *,
        hand: Literal["left", "right"] = "right",
        model: RayModel = "eye_finger",
    ) -> None:
        """Take the person's measures; a left-handed person's shoulder is on the left."""
        body = body if body is not None else BodyMeasures()
        side = 1.0 if hand == "left" else -1.0
        shoulder: Vec3 = (0.0, side * body.neck_to_shoulder_m, body.footprint_to_neck_m)
        self.origin_m: Vec3 = shoulder
        """Where the ray starts in {H}."""
        self._lever: Vec3 = (0.0, 0.0, 0.0)
        self._arm_m = 1.0
        if model == "eye_finger":
            self.origin_m = (0.0, 0.0, body.footprint_to_neck_m + body.neck_to_eyes_m)
            self._lever = vector.subtract(shoulder, self.origin_m)
            self._arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
        elif model == "forearm":
            hang_m = UPPER_ARM_SHARE * body.shoulder_to_wrist_m
            self.origin_m = vector.subtract(shoulder, (0.0, 0.0, hang_m))

    @classmethod
    def of(cls, profile: UserProfile) -> "ArmRay":
        """Return the ray of the person whose profile this is."""
        return cls(profile.body, hand=profile.hand, model=profile.ray_model)

    def direction(self, orientation_xyzw: Quaternion) -> Vec3 | None:
        """Return the unit direction in {H}, or none where the finger is at the eyes."""
        x, y, z, w = orientation_xyzw
        square = x * x + y * y + z * z + w * w  # norms are 1 to within 1e-3 only: cancels out below
        arm, lever = self._arm_m, self._lever
        ahead = arm * (square - 2.0 * (y * y + z * z)) + square * lever[0]
        left = arm * 2.0 * (x * y + w * z) + square * lever[1]
        up = arm * 2.0 * (x * z - w * y) + square * lever[2]
        length = math.hypot(ahead, left, up)
        if length < NEAREST_M * square:
            return None
        return (ahead / length, left / length, up / length)

    def rays(self, orientations_xyzw: Array) -> tuple[Array, Array]:
        """Return the rays of many orientations at once.

        Args:
            orientations_xyzw: n x 4.

        Returns:
            Origins in {H}, n x 3, m; unit directions, n x 3, NaN where the finger is at the eyes.
        """
        x, y, z, w = orientations_xyzw.T
        square = x * x + y * y + z * z + w * w
        arm = np.stack([square - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)], axis=1)
        reach = self._arm_m * arm + square[:, None] * np.array(self._lever)
        length = np.linalg.norm(reach, axis=1)
        length[length < NEAREST_M * square] = np.nan
        return np.tile(np.array(self.origin_m), (len(reach), 1)), reach / length[:, None]
