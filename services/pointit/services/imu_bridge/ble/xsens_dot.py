"""Xsens DOT and Movella DOT: quaternions of the sensor's own fusion, with its time.

Bytes are those of the maker's archived example server and of third parties that agree with it. They were
tested against a simulated sensor over a complete Bluetooth stack of others, never against a real one. Its
button and its rates other than 60 Hz are not supported: their bytes could not be verified.
"""

from collections.abc import Iterable

from pointit.services.imu_bridge.ble import xsens_dot_protocol as protocol
from pointit.services.imu_bridge.ble.ble_source import BleSource
from pointit.services.imu_bridge.ble.discovery import discover_ble
from pointit.services.imu_bridge.ble.radio import require_bleak
from pointit.services.imu_bridge.ble.wrist import BleConfig, Connection, Kind, Wrist, WristItem
from pointit.services.imu_bridge.reading import Battery, Item, Reading
from pointit.services.imu_bridge.sources import ImuSource


class XsensDotConfig(BleConfig):
    """An Xsens DOT or Movella DOT."""


class XsensDot(Wrist):
    """The commands and the notifications of a sensor."""

    kind = Kind(label="Xsens DOT", plugin="xsens_dot", names=("Xsens DOT", "Movella DOT"))
    notifications = (protocol.SHORT_PAYLOAD, protocol.BATTERY)

    def __init__(self) -> None:
        self._time = protocol.UnwrappedTime()

    def begin(self, address: str) -> None:
        """Start a new count of its time."""
        del address
        self._time = protocol.UnwrappedTime()

    async def configure(self, connection: Connection) -> None:
        """Start a measurement, after one that an earlier program may have left."""
        for command in (protocol.STOP, protocol.START):
            await connection.write(protocol.CONTROL, command)

    def received(self, characteristic: str, data: bytes, stamp_ns: int) -> Iterable[WristItem]:
        """Return the items in a notification."""
        if characteristic == protocol.BATTERY:
            return _battery(data)
        found = protocol.parse(data)
        return (
            ()
            if found is None
            else (Reading(stamp_ns, found.orientation_xyzw, self._time.ns(found.time_us)),)
        )

    async def ask(self, connection: Connection) -> Iterable[Item]:
        """Return the battery."""
        return _battery(await connection.read(protocol.BATTERY))

    async def stop(self, connection: Connection) -> None:
        """End the measurement."""
        await connection.write(protocol.CONTROL, protocol.STOP)


def _battery(data: bytes) -> Iterable[Battery]:
    level = protocol.parse_battery(data)
    return () if level is None else (Battery(level),)


XSENS_DOT = ImuSource(
    summary="an Xsens DOT or Movella DOT, by Bluetooth",
    config=XsensDotConfig,
    make=lambda config, around: BleSource(XsensDot(), config, around.clock, around.health),
    check=lambda _config: require_bleak("xsens_dot"),
    argument="address",
    argument_optional=True,
    discover=discover_ble(XsensDot.kind),
)
