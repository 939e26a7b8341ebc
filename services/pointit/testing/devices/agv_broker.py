"""A fake MQTT broker at which one virtual AGV reports, and drives as it is told."""

import asyncio

from pointit.testing.devices.mqtt_broker import MqttBrokerDevice, Published
from pointit.testing.devices.virtual_agv import VirtualAgv

TICK_S = 0.05
SPEED_MPS = 1.0
TOPICS = "uagv/v2/acme/7"


class AgvBrokerDevice(MqttBrokerDevice):
    """A broker with the AGV 7 of acme, which stands at the origin."""

    def __init__(self) -> None:
        super().__init__()
        self.agv = VirtualAgv()
        self._driving: asyncio.Task[None] | None = None

    async def plug(self) -> None:
        """Listen, and let the AGV drive."""
        await super().plug()
        self._driving = asyncio.create_task(self._drive())

    async def unplug(self) -> None:
        """Close all connections; the AGV halts."""
        if self._driving is not None:
            self._driving.cancel()
            await asyncio.wait({self._driving})
            self._driving = None
        await super().unplug()

    def take(self, message: Published) -> None:
        """Pass a message on to the AGV."""
        self.agv.receive(message.topic, message.payload)

    async def _drive(self) -> None:
        while True:
            self.agv.drive(SPEED_MPS * TICK_S)
            if self.agv.has_changed:
                await self.publish(f"{TOPICS}/state", self.agv.state())
            await self.publish(f"{TOPICS}/visualization", self.agv.visualization())
            await asyncio.sleep(TICK_S)
