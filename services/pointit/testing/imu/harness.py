"""Harness of an IMU source, given by its author, and one run of the source."""

import asyncio
import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.plugins import ImuSource, Press, Reading, Reconnected, Source
from pointit.testing.devices.device import FakeDevice
from pointit.testing.trial import Trial

POSTURE: Quaternion = rotation.from_azimuth_elevation(0.7, -0.3)
"""Orientation that the fake device sends unless told otherwise."""
OTHER_POSTURE: Quaternion = rotation.from_azimuth_elevation(-1.1, 0.4)
KEPT = 64
"""Number of readings that a trial remembers; it must not need memory of its own."""


@dataclass(frozen=True, kw_only=True)
class ImuHarness:
    """An IMU source with a fake device that stands for the real one."""

    plugin: ImuSource
    device: Callable[[], FakeDevice] = FakeDevice
    """Makes a device that is not plugged in: `TcpDevice`, `UdpDevice`, `PtyDevice` or one of your own."""
    parameters: Callable[[Any], Mapping[str, object]] = lambda _device: {}
    """Parameters of the source that lead it to the device given."""
    encode: Callable[[Quaternion], bytes] | None = None
    """Returns the bytes that the device sends for the orientation x, y, z, w. Raises ValueError if its format
    cannot express it. None if there is no device that sends."""
    wrong_parameters: tuple[Mapping[str, object], ...] = ()
    """Parameters that the source must refuse."""
    delivers: bool = True
    """False for a source without readings of its own."""
    virtual_time: bool = False
    """True if source and device wait for timers of the event loop alone: checks then take no time."""
    patience_s: float = 10.0
    """Time that the source may take to connect, to notice a loss, and to warn, s."""

    def makes(self, holds: Callable[[FakeDevice], bool]) -> bool:
        """Return True if `holds` of the device."""
        device = self.device()
        try:
            return holds(device)
        finally:
            device.close()


class ImuTrial(Trial):
    """One run of an IMU source."""

    def __init__(self, harness: ImuHarness) -> None:
        super().__init__(harness.device(), harness.patience_s)
        self._harness = harness
        self._thread = threading.get_ident()
        self.readings: deque[Reading] = deque(maxlen=KEPT)
        self.count = 0
        self.presses = 0
        self.reconnections = 0
        """Number of `Reconnected` so far."""
        self.in_loop = True
        """False once something was delivered from another thread."""
        self.wrong = ""
        """First delivered thing that was wrong in itself, in words."""

    def start(self) -> None:
        """Make the source, and run it in the background."""
        plugin = self._harness.plugin
        config = plugin.config.model_validate(dict(self._harness.parameters(self.device)))

        def make() -> Source:
            plugin.check(config)
            return plugin.make(config, self.surroundings)

        source = self.made(make)
        self.task = asyncio.create_task(source.run(self._deliver))

    async def send(self, orientation_xyzw: Quaternion = POSTURE) -> None:
        """Send one reading, if the device's format can express it."""
        if self._harness.encode is None:
            return
        try:
            data = self._harness.encode(orientation_xyzw)
        except (ValueError, OverflowError):
            return
        await self.device.send(data)

    async def hear(self, failure: str, orientation_xyzw: Quaternion = POSTURE) -> Reading:
        """Send a reading until it is delivered, and return it.

        Raises:
            CheckFailedError: If it is not.
        """
        before = self.count

        def heard() -> bool:
            new = list(self.readings)[-(self.count - before) :] if self.count > before else []
            return any(angle_rad(each.world_from_sensor, orientation_xyzw) < 0.05 for each in new)

        await self.until(heard, failure, lambda: self.send(orientation_xyzw))
        return self.readings[-1]

    def _deliver(self, item: Reading | Press | Reconnected) -> None:
        self.in_loop = self.in_loop and threading.get_ident() == self._thread
        if isinstance(item, Reconnected):
            self.reconnections += 1
        elif isinstance(item, Press):
            self.presses += 1
        else:
            self.count += 1
            self.readings.append(item)
            self.wrong = self.wrong or problem(item)


def problem(reading: Reading) -> str:
    """Return an error message if the orientation of `reading` is none, else `""`."""
    values = reading.world_from_sensor
    if len(values) != 4 or not all(isinstance(value, float) for value in values):
        return f"delivered the orientation {values!r}, which is not four floats x, y, z, w"
    norm = sum(value * value for value in values) ** 0.5
    if not abs(norm - 1.0) < 1e-3:  # also NaN
        return f"delivered the orientation {values!r}, whose norm is {norm:.4g}, not 1"
    return ""


def angle_rad(one: Quaternion, other: Quaternion) -> float:
    """Return the angle between two orientations, rad."""
    dot = abs(sum(a * b for a, b in zip(one, other, strict=True)))
    return 2.0 * math.acos(min(1.0, dot)) if math.isfinite(dot) else math.inf
