"""WitMotion's wrists by Bluetooth (WT901BLE, BWT901BLE5.0, WT9011DCL): accelerations and angular velocities.

Their angles are not used, since they are undefined with the arm straight up; imu-bridge computes the
orientation. Bytes, rates and battery are those of the maker's example programs and of third parties. They
were tested against a simulated device over a complete Bluetooth stack of others, never against a real one.
"""

import asyncio
from collections.abc import Iterable
from typing import Literal

from pydantic import Field

from pointit.services.imu_bridge.ble import witmotion_protocol as protocol
from pointit.services.imu_bridge.ble.ble_source import BleSource
from pointit.services.imu_bridge.ble.discovery import discover_ble
from pointit.services.imu_bridge.ble.radio import require_bleak
from pointit.services.imu_bridge.ble.wrist import BleConfig, Connection, Kind, Wrist, WristItem
from pointit.services.imu_bridge.reading import Battery, Item, RawReading
from pointit.services.imu_bridge.sources import ImuSource

COMMAND_S = 0.1
"""Pause that the device needs behind a command, s."""


class WitMotionBleConfig(BleConfig):
    """A WitMotion sensor with Bluetooth 5."""

    rate_hz: Literal[10, 20, 50, 100, 200] = Field(
        default=50, description="samples per second; not every model can do more than 50"
    )


class WitMotionBle(Wrist):
    """The commands and the notifications of a sensor."""

    kind = Kind(
        label="WitMotion", plugin="witmotion_ble", names=("WT",), services=frozenset({protocol.SERVICE})
    )
    notifications = (protocol.NOTIFY,)

    def __init__(self, config: WitMotionBleConfig) -> None:
        self._config = config
        self._framer = protocol.Framer()

    def begin(self, address: str) -> None:
        """Forget an unfinished frame."""
        del address
        self._framer = protocol.Framer()

    async def configure(self, connection: Connection) -> None:
        """Set the rate; the device streams by itself."""
        for command in (protocol.UNLOCK, protocol.set_rate(self._config.rate_hz)):
            await connection.write(protocol.WRITE, command)
            await asyncio.sleep(COMMAND_S)

    def received(self, characteristic: str, data: bytes, stamp_ns: int) -> Iterable[WristItem]:
        """Return the items in a notification."""
        del characteristic
        for found in self._framer.feed(data):
            if isinstance(found, protocol.Motion):
                yield RawReading(stamp_ns, found.angular_velocity_radps, found.acceleration_mps2)
            else:
                yield Battery(found.level, found.volts)

    async def ask(self, connection: Connection) -> Iterable[Item]:
        """Ask for the battery's voltage, which comes as a frame."""
        await connection.write(protocol.WRITE, protocol.READ_BATTERY)
        return ()

    async def reset(self, connection: Connection) -> None:
        """Restart the device."""
        await connection.write(protocol.WRITE, protocol.UNLOCK)
        await asyncio.sleep(COMMAND_S)
        await connection.write(protocol.WRITE, protocol.RESTART)


WITMOTION_BLE = ImuSource(
    summary="a WitMotion sensor by Bluetooth, such as the WT901BLE",
    config=WitMotionBleConfig,
    make=lambda config, around: BleSource(WitMotionBle(config), config, around.clock, around.health),
    check=lambda _config: require_bleak("witmotion_ble"),
    argument="address",
    argument_optional=True,
    discover=discover_ble(WitMotionBle.kind),
)
