"""From the sensor's orientation to the arm's: how the sensor is mounted, and where yaw 0 lies."""

import math

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion

STEEPEST_RAD = math.radians(80.0)
"""An arm steeper than this has no yaw to speak of."""

_HALF = math.sqrt(0.5)

MOUNTINGS: dict[str, Quaternion] = {
    "plus_x": rotation.IDENTITY,
    "minus_x": (0.0, 0.0, 1.0, 0.0),
    "metamotion": (0.0, 0.0, -_HALF, _HALF),
}
"""sensor_from_arm: rotates the arm's x axis, which points to the finger, into the sensor's frame."""


class ArmFrame:
    """Turns world_from_sensor into world_from_arm; the yaw origin can be set anew."""

    def __init__(self, sensor_from_arm: Quaternion, yaw_origin_rad: float = 0.0) -> None:
        self._sensor_from_arm = rotation.normalized(sensor_from_arm)
        self.set_yaw_origin(yaw_origin_rad)

    def orientation(self, world_from_sensor: Quaternion) -> Quaternion:
        """Return the arm's orientation in {H}, with norm 1."""
        turned = rotation.multiply(self._turn, world_from_sensor)
        return rotation.normalized(rotation.multiply(turned, self._sensor_from_arm))

    def set_yaw_origin(self, yaw_origin_rad: float) -> None:
        """Take the device's yaw `yaw_origin_rad` as 0 from now on."""
        self.yaw_origin_rad = vector.wrap(yaw_origin_rad)
        self._turn = rotation.from_yaw(-self.yaw_origin_rad)

    def turn_to(self, yaw_rad: float, world_from_sensor: Quaternion) -> None:
        """Set the yaw origin so that an arm with the sensor at `world_from_sensor` has azimuth `yaw_rad`.

        Raises:
            ValueError: the arm is too steep to have an azimuth.
        """
        arm = rotation.rotate(self.orientation(world_from_sensor), (1.0, 0.0, 0.0))
        steepness_rad = abs(vector.elevation(arm))
        if steepness_rad > STEEPEST_RAD:
            raise ValueError(
                f"the arm is {math.degrees(steepness_rad):.0f}° from level, so its yaw is unknown: "
                "hold it level and ask again"
            )
        self.set_yaw_origin(self.yaw_origin_rad + vector.azimuth(arm) - yaw_rad)
