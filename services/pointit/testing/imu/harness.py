"""Harness of an IMU source, given by its author, and one run of the source."""

import asyncio
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pointit.geometry import vector
from pointit.plugins import ImuSource, Item, Quaternion, RawReading, Reading, Reconnected, Source, rotation
from pointit.testing.check import called
from pointit.testing.trial import DeviceHarness, Trial

POSTURE: Quaternion = rotation.from_azimuth_elevation(0.7, -0.3)
"""Orientation that the fake device sends unless told otherwise."""
OTHER_POSTURE: Quaternion = rotation.from_azimuth_elevation(-1.1, 0.4)
NEAR_RAD = 0.05
"""Maximum error of a received orientation, since formats round, rad."""
MAX_READINGS = 64
"""Number of readings that a trial remembers; it must not need memory of its own."""


@dataclass(frozen=True, kw_only=True)
class ImuHarness(DeviceHarness[ImuSource]):
    """An IMU source with a fake device that stands for the real one."""

    encode: Callable[[Quaternion], bytes] | None = None
    """Returns the bytes that the device sends for the orientation x, y, z, w. Raises ValueError if its format
    cannot express it. None if there is no device that sends."""
    delivers: bool = True
    """False for a source without readings of its own."""

    def trial(self) -> "ImuTrial":
        """Return a trial of the source, which has not begun."""
        return ImuTrial(self)


def sends(harness: ImuHarness) -> bool:
    """Return True if there is a fake device that sends."""
    return harness.encode is not None


def encoded(harness: ImuHarness, orientation_xyzw: Quaternion) -> bytes:
    """Return the bytes of a reading, none if the device's format cannot express it."""
    try:
        return harness.encode(orientation_xyzw) if harness.encode is not None else b""
    except (ValueError, OverflowError):
        return b""


class ImuTrial(Trial):
    """One run of an IMU source."""

    def __init__(self, harness: ImuHarness) -> None:
        super().__init__(harness)
        self.harness = harness
        self.readings: deque[Reading | RawReading] = deque(maxlen=MAX_READINGS)
        self.count = 0
        self.reconnections = 0
        """Number of `Reconnected` so far."""
        self.wrong = ""
        """First delivered thing that was wrong in itself, in words."""

    def make(self, config: Any) -> Source:
        """Check the parameters, and make the source."""
        self.harness.plugin.check(config)
        return self.harness.plugin.make(config, self.surroundings)

    async def start(self) -> None:
        """Run the source in the background."""
        with called("make"):
            source = self.make(self.config)
        self.task = asyncio.create_task(source.run(self._deliver))

    async def exchange(self, situation: str = "the device was connected") -> None:
        """Wait until a reading is delivered, if the source has any."""
        failure = f"{situation}, and no reading was delivered"
        if sends(self.harness):
            await self.hear(failure)
        elif self.harness.delivers:
            await self.until(lambda: self.count > 0, failure)

    async def live(self) -> None:
        """Disconnect and reconnect the device, if there is one."""
        if sends(self.harness):
            await self.replug()

    async def send(self, orientation_xyzw: Quaternion = POSTURE) -> None:
        """Send one reading, if the device's format can express it."""
        data = encoded(self.harness, orientation_xyzw)
        if data:
            await self.device.send(data)

    async def hear(self, failure: str, orientation_xyzw: Quaternion = POSTURE) -> None:
        """Send a reading until it is delivered. Raises CheckFailedError if it is not."""
        self.readings.clear()

        def is_received() -> bool:
            return any(shows(each, orientation_xyzw) for each in self.readings)

        await self.until(is_received, failure, lambda: self.send(orientation_xyzw))

    def _deliver(self, item: Item) -> None:
        self.health.note_thread("deliver")
        if isinstance(item, Reconnected):
            self.reconnections += 1
        elif isinstance(item, Reading | RawReading):
            self.count += 1
            self.readings.append(item)
            self.wrong = self.wrong or problem(item)


def problem(reading: Reading | RawReading) -> str:
    """Return an error message if the orientation, or the raw values, of `reading` are none, else `""`."""
    if isinstance(reading, RawReading):
        raw = (*reading.angular_velocity_radps, *reading.acceleration_mps2)
        if len(raw) == 6 and all(isinstance(value, float) and math.isfinite(value) for value in raw):
            return ""
        return f"delivered the raw values {raw!r}, which are not two times three finite floats"
    values = reading.world_from_sensor
    if len(values) != 4 or not all(isinstance(value, float) for value in values):
        return f"delivered the orientation {values!r}, which is not four floats x, y, z, w"
    norm = sum(value * value for value in values) ** 0.5
    if not abs(norm - 1.0) < 1e-3:  # also NaN
        return f"delivered the orientation {values!r}, whose norm is {norm:.4g}, not 1"
    return ""


def shows(reading: Reading | RawReading, orientation_xyzw: Quaternion) -> bool:
    """Return True if `reading` is of a sensor at rest in that orientation; a raw one shows no yaw."""
    if isinstance(reading, Reading):
        return is_near(reading.world_from_sensor, orientation_xyzw)
    up = rotation.rotate(rotation.inverse(orientation_xyzw), (0.0, 0.0, 1.0))
    measured = reading.acceleration_mps2
    return any(measured) and vector.angle_between(measured, up) < NEAR_RAD


def is_near(one: Quaternion, other: Quaternion) -> bool:
    """Return True if two orientations differ by less than 0.05 rad."""
    return abs(sum(a * b for a, b in zip(one, other, strict=True))) > math.cos(NEAR_RAD / 2)
