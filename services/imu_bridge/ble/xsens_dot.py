"""Xsens DOT and Movella DOT: quaternions of the sensor's own fusion with its time, from the short payload.

payload = u32 time in µs, then f32 w, x, y, z; little-endian

Bytes are those of the maker's archived example server and of third parties that agree with it. They were
tested against a simulated sensor over a complete Bluetooth stack of others, never against a real one. Its
button and its rates other than 60 Hz are not supported: their bytes could not be verified.

No core: it waits for a radio.
"""

import struct
from collections.abc import Iterable

from pointit.schemas.base import unit_quaternion
from pointit.services.imu_bridge.ble.ble_source import BleSource, discover_ble
from pointit.services.imu_bridge.ble.radio import require_bleak
from pointit.services.imu_bridge.ble.wrist import BleConfig, Connection, Kind, Wrist, WristItem
from pointit.services.imu_bridge.sources import Battery, ImuSource, Item, Reading

CONTROL = "15172001-4947-11e9-8646-d663bd873d93"
SHORT_PAYLOAD = "15172004-4947-11e9-8646-d663bd873d93"
BATTERY = "15173001-4947-11e9-8646-d663bd873d93"
START = bytes.fromhex("010105")
STOP = bytes.fromhex("010005")
"""Payload 5: orientation as a quaternion."""


def parse(data: bytes, stamp_ns: int) -> Reading | None:
    """Return the reading in a short payload, or None if it is broken.

    Its time wraps after 71 minutes, after which imu-bridge goes on.
    """
    if len(data) < 20:
        return None
    time_us, w, x, y, z = struct.unpack_from("<I4f", data)
    try:
        return Reading(stamp_ns, unit_quaternion((x, y, z, w)), 1000 * time_us)
    except ValueError:
        return None


def _battery(data: bytes) -> Iterable[Battery]:
    return (Battery(min(data[0], 100) / 100.0),) if data else ()


class XsensDotConfig(BleConfig):
    """An Xsens DOT or Movella DOT."""


class XsensDot(Wrist):
    """The commands and the notifications of a sensor."""

    kind = Kind(label="Xsens DOT", plugin="xsens_dot", names=("Xsens DOT", "Movella DOT"))
    notifications = (SHORT_PAYLOAD, BATTERY)

    async def configure(self, connection: Connection) -> None:
        """Start a measurement, after one that an earlier program may have left."""
        for command in (STOP, START):
            await connection.write(CONTROL, command)

    def received(self, characteristic: str, data: bytes, stamp_ns: int) -> Iterable[WristItem]:
        """Return the items in a notification."""
        if characteristic == BATTERY:
            return _battery(data)
        reading = parse(data, stamp_ns)
        return () if reading is None else (reading,)

    async def ask(self, connection: Connection) -> Iterable[Item]:
        """Return the battery."""
        return _battery(await connection.read(BATTERY))

    async def stop(self, connection: Connection) -> None:
        """End the measurement."""
        await connection.write(CONTROL, STOP)


XSENS_DOT = ImuSource(
    summary="an Xsens DOT or Movella DOT, by Bluetooth",
    config=XsensDotConfig,
    make=lambda config, around: BleSource(XsensDot(), config, around.clock, around.health),
    check=lambda _config: require_bleak("xsens_dot"),
    argument="sensor",
    argument_optional=True,
    discover=discover_ble(XsensDot.kind),
)
