"""Conversion of the sensor's orientation to the arm's, by the mounting and the yaw origin."""

import math

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion

MAX_ELEVATION_RAD = math.radians(80.0)
"""Largest elevation of an arm with a usable yaw."""

_HALF = math.sqrt(0.5)

_PLUS_X = rotation.IDENTITY
_MINUS_X: Quaternion = (0.0, 0.0, 1.0, 0.0)
_PLUS_Y: Quaternion = (0.0, 0.0, _HALF, _HALF)
_MINUS_Y: Quaternion = (0.0, 0.0, -_HALF, _HALF)

MOUNTINGS: dict[str, Quaternion] = {
    "plus_x": _PLUS_X,
    "minus_x": _MINUS_X,
    "plus_y": _PLUS_Y,
    "minus_y": _MINUS_Y,
    "metamotion": _MINUS_Y,
    "myo": _MINUS_X,
    "watch_left": _PLUS_X,
    "watch_right": _MINUS_X,
    "phone": _PLUS_Y,
}
"""sensor_from_arm: rotates the arm's x axis, which points to the finger, into the sensor's frame.

All keep z: up on the sensor is up on the arm, palm down. Devices with a screen have x to its right, y to its
top and z out of it (Android's and Pebble's documentation). A watch is worn face out on the back of the wrist,
so that the right of its screen is towards the fingers on the left arm only; a phone has its top towards the
fingers."""


def from_roll_pitch_yaw(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Return the rotation by roll about x, then pitch about y, then yaw about z, all axes fixed."""
    roll = rotation.from_axis_angle((1.0, 0.0, 0.0), roll_rad)
    pitch = rotation.from_axis_angle((0.0, 1.0, 0.0), pitch_rad)
    return rotation.multiply(rotation.from_yaw(yaw_rad), rotation.multiply(pitch, roll))


class ArmFrame:
    """Converts world_from_sensor to world_from_arm, with a settable mounting and yaw origin."""

    def __init__(self, sensor_from_arm: Quaternion, yaw_origin_rad: float = 0.0) -> None:
        self.set_mounting(sensor_from_arm)
        self.set_yaw_origin(yaw_origin_rad)

    def set_mounting(self, sensor_from_arm: Quaternion) -> None:
        """Set the mounting of the sensor on the arm."""
        self._sensor_from_arm = rotation.normalized(sensor_from_arm)

    def orientation(self, world_from_sensor: Quaternion) -> Quaternion:
        """Return the arm's orientation in {H}, with norm 1."""
        turned = rotation.multiply(self._turn, world_from_sensor)
        return rotation.normalized(rotation.multiply(turned, self._sensor_from_arm))

    def set_yaw_origin(self, yaw_origin_rad: float) -> None:
        """Set the device's yaw that counts as 0."""
        self.yaw_origin_rad = vector.wrap(yaw_origin_rad)
        self._turn = rotation.from_yaw(-self.yaw_origin_rad)

    def set_azimuth(self, yaw_rad: float, world_from_sensor: Quaternion) -> None:
        """Set the yaw origin so that an arm with the sensor at `world_from_sensor` has azimuth `yaw_rad`.

        Raises:
            ValueError: If the arm is too steep to have an azimuth.
        """
        arm = rotation.rotate(self.orientation(world_from_sensor), (1.0, 0.0, 0.0))
        steepness_rad = abs(vector.elevation(arm))
        if steepness_rad > MAX_ELEVATION_RAD:
            raise ValueError(
                f"the arm is {math.degrees(steepness_rad):.0f}° from level, so its yaw is unknown: "
                "hold it level and ask again"
            )
        self.set_yaw_origin(self.yaw_origin_rad + vector.azimuth(arm) - yaw_rad)
