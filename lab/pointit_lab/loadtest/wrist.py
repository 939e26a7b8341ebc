"""Simulated wrists: samples at a steady rate, spread evenly over the period."""

import asyncio
import math
from collections.abc import Sequence

from pointit.geometry import rotation
from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import Clock, WallClock
from pointit.schemas import ImuSample

SWEEP_RAD = 0.3
"""Amplitude of the sweep."""

ELEVATION_RAD = -0.02

WALL_CLOCK = WallClock()


class LoadTestWrist:
    """Publishes samples of an arm that sweeps to and fro."""

    def __init__(
        self, publisher: Publisher[ImuSample], phase_rad: float = 0.0, clock: Clock = WALL_CLOCK
    ) -> None:
        self._publisher = publisher
        self._phase_rad = phase_rad
        self._clock = clock
        self.sent = 0
        self.stamp_ns = 0
        """Stamp of the newest sample."""

    def put(self) -> None:
        """Publish one sample, captured now."""
        self.sent += 1
        self.stamp_ns = self._clock.now_ns()
        phase_rad = self.sent / 50 + self._phase_rad
        azimuth_rad = SWEEP_RAD * math.sin(phase_rad)
        orientation_xyzw = rotation.from_azimuth_elevation(azimuth_rad, ELEVATION_RAD)
        sample = ImuSample(stamp_ns=self.stamp_ns, seq=self.sent, orientation_xyzw=orientation_xyzw)
        self._publisher.put(sample)


async def drive_wrists(wrists: Sequence[LoadTestWrist], rate_hz: float, duration_s: float) -> None:
    """Publish `rate_hz` samples per second from every wrist for `duration_s`.

    Samples that are not published within their period are skipped and missing from `sent`. In a burst they
    would replace each other, and this generator would cause the drops.
    """
    if not wrists:
        await asyncio.sleep(duration_s)
        return
    loop = asyncio.get_running_loop()
    start_s = loop.time()
    per_s = rate_hz * len(wrists)
    for turn in range(round(per_s * duration_s)):
        number = turn % len(wrists)
        wait_s = start_s + turn / per_s - loop.time()
        # a late generator yields to the services once a period, too
        if wait_s > 0 or number == 0:
            await asyncio.sleep(max(0.0, wait_s))
        if wait_s > -1.0 / rate_hz:
            wrists[number].put()
