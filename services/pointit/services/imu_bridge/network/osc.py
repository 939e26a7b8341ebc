"""Wrists that speak Open Sound Control: NGIMU, and apps of phones such as GyrOSC, ZIG SIM and Sensors2OSC."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from pydantic import Field, field_validator

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.contents import DatagramError, Order, orientation, vector
from pointit.services.imu_bridge.network.datagram_source import DatagramConfig, DatagramSource, Decoder
from pointit.services.imu_bridge.reading import Battery, Item, Press, RawReading, Reading
from pointit.services.imu_bridge.sources import ImuSource

GRAVITY_MPS2 = 9.80665
ORDERS: Final[dict[str, Order]] = {
    "/quaternion": "wxyz",  # NGIMU
    "/gyrosc/quat": "wxyz",
    "/SceneRotator/quaternions": "wxyz",
    "/rotationvector": "xyzw",  # Sensors2OSC, as Android states it
    "/gamerotationvector": "xyzw",
}
"""Orders of the numbers at addresses of known devices."""
NAMES = frozenset(address.rpartition("/")[2] for address in ORDERS)
"""Last parts of addresses of orientations."""
ZIG_SIM = "/ZIGSIM/"
"""Beginning of addresses of ZIG SIM on iPhones; before, and on Android, they begin with the device's name."""
SENSORS = "/sensors"
"""NGIMU's rates, °/s, then its accelerations, g."""
LONGEST_DATAGRAM = 8192
MOST_MESSAGES = 64
DEEPEST = 4
"""Bundles within bundles that are read."""
IMMEDIATELY = 1
"""Time tag of a bundle without a time."""
UNIX_S = 2_208_988_800
"""Seconds from OSC's epoch, 1900, to that of Unix."""
_BUNDLE = b"#bundle\0"
_NUMBERS = {
    "i": struct.Struct(">i"),
    "f": struct.Struct(">f"),
    "h": struct.Struct(">q"),
    "d": struct.Struct(">d"),
}
_SIZES = {"t": 8, "c": 4, "r": 4, "m": 4}
"""Sizes of arguments that are passed over, bytes."""
_CONSTANTS: dict[str, float] = {"T": 1.0, "F": 0.0, "I": 1.0}


@dataclass(frozen=True, slots=True)
class OscMessage:
    """An address and the numbers behind it; other arguments are left out."""

    address: str
    numbers: tuple[float, ...]
    time_ns: int | None
    """Time of its bundle, or None: Unix ns of the sender, ns since its start if its clock was never set."""


class OscConfig(DatagramConfig):
    """A device that sends Open Sound Control."""

    port: int = Field(
        default=9000,
        ge=1,
        le=65535,
        description="UDP port to which the device sends; each person has another",
    )
    address: str = Field(
        default="",
        description="address of the messages with the orientation, such as /gyrosc/quat; each that ends "
        "in /quaternion, /quaternions, /quat, /rotationvector or /gamerotationvector if empty",
    )
    order: Literal["auto", "wxyz", "xyzw"] = Field(
        default="auto",
        description="order of the quaternion's numbers in a message; auto: xyzw behind the addresses of ZIG "
        "SIM (/ZIGSIM/NAME/quaternion, /NAME/quaternion) and Sensors2OSC (/rotationvector, "
        "/gamerotationvector), else wxyz, with a warning behind an address that is not known",
    )

    @field_validator("address")
    @classmethod
    def _rooted(cls, value: str) -> str:
        if value and not value.startswith("/"):
            raise ValueError("must begin with /, such as /gyrosc/quat")
        return value


class OscDecoder(Decoder):
    """Reads the messages of one device. Its rates are used until it sends an orientation."""

    def __init__(self, config: OscConfig) -> None:
        self._config = config
        self._has_orientation = False
        self._zig_sim = ""
        """Address of the orientations of a ZIG SIM that has introduced itself, or `""`."""
        self._battery: Battery | None = None

    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the readings and events of a datagram.

        Raises:
            DatagramError: If it is not OSC, or its orientation is none.
        """
        found = [self._item(message, stamp_ns) for message in parse(data)]
        return [item for item in found if item is not None]

    def _item(self, message: OscMessage, stamp_ns: int) -> Item | None:
        address, numbers = message.address, message.numbers
        if self._is_orientation(address) and len(numbers) >= 4:
            self._has_orientation = True
            return Reading(stamp_ns, orientation(numbers[:4], self._order(address)), message.time_ns)
        if address == SENSORS and len(numbers) >= 6 and not self._has_orientation:
            rates = vector(numbers[0:3], math.radians(1.0))
            return RawReading(stamp_ns, rates, vector(numbers[3:6], GRAVITY_MPS2), message.time_ns)
        if address == "/battery" and len(numbers) >= 3:
            return self._changed_battery(numbers)
        if address.endswith("/deviceinfo"):
            self._zig_sim, self.doubt = f"{address.removesuffix('deviceinfo')}quaternion", ""
        if address.rpartition("/")[2] == "button" and (not numbers or numbers[-1] > 0):
            return Press(stamp_ns)
        return None

    def _is_orientation(self, address: str) -> bool:
        return address == self._config.address or (
            not self._config.address and address.rpartition("/")[2] in NAMES
        )

    def _order(self, address: str) -> Order:
        if self._config.order != "auto":
            return self._config.order
        order = ORDERS.get(address)
        if order is None:
            is_zig_sim = address == self._zig_sim or address.startswith(ZIG_SIM)
            has_name = address.count("/") == 2 and address.endswith("/quaternion")
            order = "xyzw" if is_zig_sim or has_name else "wxyz"
            if not is_zig_sim:
                self.doubt = (
                    f"the order of the numbers at {address} is not known; they are read as {order}: set "
                    "osc.order to wxyz or xyzw"
                )
        return order

    def _changed_battery(self, numbers: Sequence[float]) -> Battery | None:
        """Return NGIMU's battery if it differs from before: percent, minutes left, volts."""
        percent, _, volts = numbers[:3]
        if not (0.0 <= percent <= 100.0 and 0.0 < volts < 100.0):
            return None
        battery = Battery(percent / 100.0, volts)
        if battery == self._battery:
            return None
        self._battery = battery
        return battery


OSC = ImuSource(
    summary="a device or app that sends Open Sound Control: NGIMU, GyrOSC, ZIG SIM",
    config=OscConfig,
    make=lambda config, around: DatagramSource(
        "osc", config, lambda: OscDecoder(config), around.clock, around.health
    ),
    argument="port",
    argument_optional=True,
    example="9000",
)


def parse(data: bytes) -> list[OscMessage]:
    """Return the messages of a datagram, also those of bundles in it.

    Raises:
        DatagramError: If it is not OSC.
    """
    if len(data) > LONGEST_DATAGRAM:
        raise DatagramError(f"has {len(data)} bytes, more than {LONGEST_DATAGRAM}")
    messages: list[OscMessage] = []
    try:
        _read(data, None, 0, messages)
    except (struct.error, ValueError, OverflowError) as error:
        raise DatagramError(f"is not OSC: {error}") from error
    return messages


def _read(data: bytes, time_ns: int | None, depth: int, messages: list[OscMessage]) -> None:
    if not data.startswith(_BUNDLE):
        if len(messages) < MOST_MESSAGES:
            messages.append(_message(data, time_ns))
        return
    if depth >= DEEPEST:
        raise ValueError("too many bundles in bundles")
    (tag,) = struct.unpack_from(">Q", data, len(_BUNDLE))
    if tag > IMMEDIATELY:
        seconds = tag >> 32
        seconds -= UNIX_S if seconds >= UNIX_S else 0
        time_ns = seconds * NS_PER_S + ((tag & 0xFFFFFFFF) * NS_PER_S >> 32)
    at = len(_BUNDLE) + 8
    while at < len(data):
        (size,) = struct.unpack_from(">i", data, at)
        at += 4
        if size <= 0 or at + size > len(data):
            raise ValueError(f"an element of {size} bytes")
        _read(data[at : at + size], time_ns, depth + 1, messages)
        at += size


def _message(data: bytes, time_ns: int | None) -> OscMessage:
    address, at = _text(data, 0)
    if not address.startswith("/"):
        raise ValueError("an address without /")
    if at >= len(data):  # old senders leave the types out if there is no argument
        return OscMessage(address, (), time_ns)
    types, at = _text(data, at)
    if not types.startswith(","):
        raise ValueError("no types of arguments")
    numbers: list[float] = []
    for kind in types[1:]:
        if kind in _NUMBERS:
            numbers.append(float(_NUMBERS[kind].unpack_from(data, at)[0]))
            at += _NUMBERS[kind].size
        elif kind in _CONSTANTS:
            numbers.append(_CONSTANTS[kind])
        else:
            at = _behind(kind, data, at)
    if at > len(data):
        raise ValueError("a cut-off argument")
    return OscMessage(address, tuple(numbers), time_ns)


def _behind(kind: str, data: bytes, at: int) -> int:
    """Return where the argument at `at`, which is no number, ends."""
    if kind in "sS":
        return _text(data, at)[1]
    if kind == "b":
        (size,) = struct.unpack_from(">I", data, at)
        return int(at + 4 + size + -size % 4)
    if kind in _SIZES:
        return at + _SIZES[kind]
    if kind in "N[]":
        return at
    raise ValueError(f"an argument of the unknown type {kind!r}")


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(b"\0", at)  # raises ValueError
    return data[at:end].decode("ascii"), end + 4 - (end - at) % 4
