"""WitMotion's wrists by Bluetooth: WT901BLE, BWT901BLE5.0, WT9011DCL.

    frame = 55 61 (i16 little-endian){9}         acceleration, angular velocity, angles; no checksum
    reply = 55 71 register 00 (i16){8}           registers that were asked for

Frames may be split over notifications, or several be in one. There is no time in them.

Their angles are not used, since they are undefined with the arm straight up; imu-bridge computes the
orientation. Bytes, rates and battery are those of the maker's example programs and of third parties. They
were tested against a simulated device over a complete Bluetooth stack of others, never against a real one.

No core: it waits for a radio.
"""

import asyncio
import math
import struct
from collections.abc import Iterable
from typing import Literal

import numpy as np
from pydantic import Field

from pointit.services.imu_bridge.ble.ble_source import BleSource, discover_ble
from pointit.services.imu_bridge.ble.radio import require_bleak
from pointit.services.imu_bridge.ble.wrist import BleConfig, Connection, Kind, Wrist, WristItem
from pointit.services.imu_bridge.sources import Battery, ImuSource, Item, RawReading

SERVICE = "0000ffe5-0000-1000-8000-00805f9a34fb"
NOTIFY = "0000ffe4-0000-1000-8000-00805f9a34fb"
WRITE = "0000ffe9-0000-1000-8000-00805f9a34fb"
"""Their base is not the usual one: it ends in 9a34fb."""
FRAME_BYTES = 20
STANDARD_GRAVITY_MPS2 = 9.80665
ACCELERATION_SCALE = 16.0 * STANDARD_GRAVITY_MPS2 / 32768.0
RATE_SCALE = math.radians(2000.0) / 32768.0
BATTERY_REGISTER = 0x64
UNLOCK = bytes.fromhex("ffaa6988b5")
READ_BATTERY = bytes.fromhex("ffaa276400")
RESTART = bytes.fromhex("ffaa00ff00")
RATES: dict[int, int] = {10: 6, 20: 7, 50: 8, 100: 9, 200: 11}
"""Codes of the rates in Hz."""
_CHARGE_VOLTS = (3.40, 3.50, 3.68, 3.70, 3.73, 3.77, 3.79, 3.82, 3.87, 3.93, 3.96, 4.05)
_CHARGE_LEVELS = (0.0, 0.05, 0.10, 0.15, 0.20, 0.30, 0.40, 0.50, 0.60, 0.75, 0.90, 1.0)
"""Charge of the cell at each of the `_CHARGE_VOLTS`."""

COMMAND_S = 0.1
"""Pause that the device needs behind a command, s."""


def charge_level(volts: float) -> float:
    """Return the charge of the battery, 0 to 1, as its voltage suggests."""
    return float(np.interp(volts, _CHARGE_VOLTS, _CHARGE_LEVELS))


class Framer:
    """Cuts what was notified into frames, and buffers less than one of them."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes, stamp_ns: int) -> list[RawReading | Battery]:
        """Return the items in the frames that `data` completes. Other bytes are skipped."""
        data = self._rest + data
        items: list[RawReading | Battery] = []
        at = 0
        while (at := data.find(b"\x55", at)) >= 0:
            if len(data) - at >= 2 and data[at + 1] not in (0x61, 0x71):
                at += 1
                continue
            frame = data[at : at + FRAME_BYTES]
            if len(frame) < FRAME_BYTES:
                break
            item = _decode_frame(frame, stamp_ns)
            if item is not None:
                items.append(item)
            at += FRAME_BYTES
        self._rest = data[at:] if at >= 0 else b""
        return items


def set_rate(rate_hz: int) -> bytes:
    """Return the command that sets the rate, one of `RATES`, until the device is restarted."""
    return bytes((0xFF, 0xAA, 0x03, RATES[rate_hz], 0x00))


def _decode_frame(frame: bytes, stamp_ns: int) -> RawReading | Battery | None:
    if frame[1] == 0x61:
        ax, ay, az, wx, wy, wz = struct.unpack_from("<6h", frame, 2)
        return RawReading(
            stamp_ns,
            (wx * RATE_SCALE, wy * RATE_SCALE, wz * RATE_SCALE),
            (ax * ACCELERATION_SCALE, ay * ACCELERATION_SCALE, az * ACCELERATION_SCALE),
        )
    if frame[2] == BATTERY_REGISTER:
        volts = int.from_bytes(frame[4:6], "little") / 100.0
        return Battery(charge_level(volts), volts)
    return None


class WitMotionBleConfig(BleConfig):
    """A WitMotion sensor with Bluetooth 5."""

    rate_hz: Literal[10, 20, 50, 100, 200] = Field(
        default=50, description="samples per second; not every model can do more than 50"
    )


class WitMotionBle(Wrist):
    """The commands and the notifications of a sensor."""

    kind = Kind(label="WitMotion", plugin="witmotion_ble", names=("WT",), services=frozenset({SERVICE}))
    notifications = (NOTIFY,)

    def __init__(self, config: WitMotionBleConfig) -> None:
        self._config = config
        self._framer = Framer()

    def begin(self, address: str) -> None:
        """Forget an unfinished frame."""
        del address
        self._framer = Framer()

    async def configure(self, connection: Connection) -> None:
        """Set the rate; the device streams by itself."""
        for command in (UNLOCK, set_rate(self._config.rate_hz)):
            await connection.write(WRITE, command)
            await asyncio.sleep(COMMAND_S)

    def received(self, characteristic: str, data: bytes, stamp_ns: int) -> Iterable[WristItem]:
        """Return the items in a notification."""
        del characteristic
        return self._framer.feed(data, stamp_ns)

    async def ask(self, connection: Connection) -> Iterable[Item]:
        """Ask for the battery's voltage, which comes as a frame."""
        await connection.write(WRITE, READ_BATTERY)
        return ()

    async def reset(self, connection: Connection) -> None:
        """Restart the device."""
        await connection.write(WRITE, UNLOCK)
        await asyncio.sleep(COMMAND_S)
        await connection.write(WRITE, RESTART)


WITMOTION_BLE = ImuSource(
    summary="a WitMotion sensor by Bluetooth, such as the WT901BLE",
    config=WitMotionBleConfig,
    make=lambda config, around: BleSource(WitMotionBle(config), config, around.clock, around.health),
    check=lambda _config: require_bleak("witmotion_ble"),
    argument="sensor",
    argument_optional=True,
    discover=discover_ble(WitMotionBle.kind),
)
