"""Orientation of the sensor to that of the arm, by the mounting and the yaw origin, and new yaw origins."""

import itertools
import math
from collections.abc import Iterator

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S

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
BACK_NS = NS_PER_S
"""Device time that falls by more is a restart; by less, samples came out of order."""
WRAP_NS = 2**32 * 1000
"""Boards that count microseconds in 32 bits restart at 0 after 71 minutes of operation."""


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
        heading_corrected = rotation.multiply(self._turn, world_from_sensor)
        return rotation.normalized(rotation.multiply(heading_corrected, self._sensor_from_arm))

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


class YawEpoch:
    """Counts yaw origins, and unwraps the device time."""

    def __init__(self, numbers: Iterator[int] | None = None) -> None:
        """Use `numbers`, which may be shared, for new origins; or count from 1."""
        self._numbers = itertools.count(1) if numbers is None else numbers
        self.count = 0
        """Number of the present origin, unique among origins."""
        self._has_read = False
        self._newest_ns: int | None = None
        """Device time as received."""
        self._wrapped_ns = 0

    def start_new_epoch(self) -> None:
        """Start a new origin after the origin or the mounting was set."""
        self.count = next(self._numbers)

    def reconnected(self, *, keeps_yaw: bool = False) -> None:
        """Start a new origin unless the device kept its own: it may have been restarted, or be another."""
        if keeps_yaw:
            return
        if self._has_read:
            self.count = next(self._numbers)
        self._newest_ns = None
        self._wrapped_ns = 0

    def read(self, device_time_ns: int | None) -> int | None:
        """Return a sample's device time without wraps; a restart starts a new origin."""
        self._has_read = True
        newest_ns = self._newest_ns
        if device_time_ns is None:
            return None
        if newest_ns is None or device_time_ns >= newest_ns:
            self._newest_ns = device_time_ns
        elif newest_ns - device_time_ns > BACK_NS:
            if 0 <= WRAP_NS - newest_ns < BACK_NS and device_time_ns < BACK_NS:
                self._wrapped_ns += WRAP_NS
            else:
                self.count = next(self._numbers)
                self._wrapped_ns = 0
            self._newest_ns = device_time_ns
        return device_time_ns + self._wrapped_ns
