"""A wrist in the network: a SlimeVR tracker that calls until it is answered, and sends how it is held."""

import asyncio
import struct
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.geometry.rotation import IDENTITY
from pointit.services.imu_bridge.network.slimevr_protocol import PORT
from pointit_lab.devices.contracts.network import FakeSlimevrTracker, slimevr_rotation
from tests.support.bench import background

MAC = "02:00:0A:0B:0C:0D"
"""Address of each `Tracker`."""


class Tracker(FakeSlimevrTracker):
    """A wrist in the network, at the port at which all of its kind call."""

    def __init__(self) -> None:
        super().__init__()
        self.program_port = PORT
        self.orientation = IDENTITY
        self.sent = 0
        """Number of orientations."""

    async def wear(self) -> None:
        """Send its orientation and battery until cancelled."""
        battery = struct.pack(">IQff", 12, 0, 3.9, 0.82)
        while True:
            await self.send(battery)
            for _ in range(50):
                await self.send(slimevr_rotation(self.orientation))
                self.sent += 1
                await asyncio.sleep(0.02)


@asynccontextmanager
async def tracker() -> AsyncGenerator[Tracker]:
    device = Tracker()
    await device.plug()
    try:
        async with background(device.wear()):
            yield device
    finally:
        await device.unplug()
        device.close()
