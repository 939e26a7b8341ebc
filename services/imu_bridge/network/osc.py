"""Wrists that speak Open Sound Control: NGIMU, and apps of phones such as GyrOSC, ZIG SIM and Sensors2OSC."""

import math
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from pydantic import Field, field_validator, model_validator

from pointit.runtime.config.parameters import set_option
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.datagram_source import (
    DatagramConfig,
    DatagramSource,
    Decoder,
    vector,
)
from pointit.services.imu_bridge.sources import Battery, ImuSource, Item, Press, RawReading, Reading
from pointit.services.imu_bridge.streams import ContentError, Order, SensorChoice, component, unit_rotation

LONGEST_DATAGRAM = 8192
MAX_MESSAGES = 64
DEEPEST = 4
"""Bundles within bundles that are read."""
IMMEDIATELY = 1
"""Time tag of a bundle without a time."""
UNIX_S = 2_208_988_800
"""Seconds from OSC's epoch, 1900, to that of Unix."""
MIN_UNTYPED = 16
"""Fewest bytes of arguments without types that are read as floats, as old senders leave the types out."""
_BUNDLE = b"#bundle\0"
_NUMBERS = {
    "i": struct.Struct(">i"),
    "f": struct.Struct(">f"),
    "h": struct.Struct(">q"),
    "d": struct.Struct(">d"),
}
_SIZES = {"t": 8, "c": 4, "r": 4, "m": 4, "N": 0, "[": 0, "]": 0}
"""Sizes of arguments that are passed over, bytes."""
_CONSTANTS: dict[str, float] = {"T": 1.0, "F": 0.0, "I": 1.0}

GRAVITY_MPS2 = 9.80665
ORDER_OPTION = set_option("imu-bridge", "osc.order", "xyzw")
ORDERS: Final[dict[str, Order]] = {
    "/quaternion": "wxyz",  # NGIMU
    "/gyrosc/quat": "wxyz",
    "/SceneRotator/quaternions": "wxyz",
    "/rotationvector": "xyzw",  # Sensors2OSC, as Android states it
    "/gamerotationvector": "xyzw",
}
"""Orders of the numbers at addresses of known devices."""
ACCURATE = frozenset({"/rotationvector", "/gamerotationvector"})
"""Addresses of messages that begin with the quaternion, and may have its accuracy behind it."""
ZIG_SIM = "/ZIGSIM/"
"""Beginning of addresses of ZIG SIM on iPhones; before, and on Android, they begin with the device's name."""
SENSORS = "/sensors"
"""NGIMU's rates, °/s, then its accelerations, g."""
MAX_SHOWN = 4
"""Number of addresses without an orientation that a warning names."""


@dataclass(frozen=True, slots=True)
class OscMessage:
    """An address, and the numbers and strings behind it; other arguments are left out."""

    address: str
    numbers: tuple[float, ...]
    """Also those in strings."""
    time_ns: int | None
    """Time of its bundle, or None: Unix ns of the sender, ns since its start if its clock was never set."""
    strings: tuple[str, ...] = field(default=(), compare=False)
    """Strings that are not numbers."""
    problem: str = field(default="", compare=False)
    """Clause about an argument from which on nothing could be read, or `""`."""


def parse(data: bytes) -> tuple[list[OscMessage], str]:
    """Return the messages of a datagram that can be read, also those of bundles in it.

    The text is a clause about those that cannot be read, or `""`.
    """
    if len(data) > LONGEST_DATAGRAM:
        return [], f"has {len(data)} bytes, more than {LONGEST_DATAGRAM}"
    messages: list[OscMessage] = []
    problem = ""
    for content, time_ns in _contents(data, None, 0):
        if len(messages) >= MAX_MESSAGES:
            break
        try:
            messages.append(_parse_message(content, time_ns))
        except ValueError as error:
            problem = problem or f"is not OSC: {error}"
    return messages, problem


def _contents(data: bytes, time_ns: int | None, depth: int) -> Iterator[tuple[bytes, int | None]]:
    """Yield the bytes of each message and the time of its bundle; `b""` for a part that is cut off."""
    offset = len(_BUNDLE) + 8
    is_bundle = data.startswith(_BUNDLE) and len(data) >= offset
    if not is_bundle or depth >= DEEPEST:
        yield data, time_ns
        return

    # Its time is NTP's. A sender whose clock was never set counts from its start.
    tag = int.from_bytes(data[len(_BUNDLE) : offset])
    if tag > IMMEDIATELY:
        seconds = tag >> 32
        if seconds >= UNIX_S:
            seconds -= UNIX_S
        fraction_ns = (tag & 0xFFFFFFFF) * NS_PER_S >> 32
        time_ns = seconds * NS_PER_S + fraction_ns

    # Its elements, each behind its size
    while offset < len(data):
        size = int.from_bytes(data[offset : offset + 4], signed=True)
        offset += 4
        if size <= 0 or offset + size > len(data):
            yield b"", None
            return
        yield from _contents(data[offset : offset + size], time_ns, depth + 1)
        offset += size


def _parse_message(data: bytes, time_ns: int | None) -> OscMessage:
    """Return the message in `data`.

    Raises:
        ValueError: If it has no address, or none of its arguments can be read.
    """
    if not data:
        raise ValueError("an element of a bundle is cut off")
    if data.startswith(_BUNDLE):  # `_contents` has not opened it
        raise ValueError("too many bundles in bundles, or one that is cut off")
    address, offset = _parse_text(data, 0)
    if not address.startswith("/"):
        raise ValueError("an address without /")
    if offset >= len(data):  # old senders leave the types out if there is no argument
        return OscMessage(address, (), time_ns)

    # Arguments without types are floats
    rest = data[offset:]
    if not rest.startswith(b","):
        if len(rest) < MIN_UNTYPED or len(rest) % 4:
            raise ValueError("no types of arguments")
        return OscMessage(address, struct.unpack(f">{len(rest) // 4}f", rest), time_ns)
    types, offset = _parse_text(data, offset)
    message = _typed_message(address, types[1:], data[offset:], time_ns)
    is_empty = not message.numbers and not message.strings
    if message.problem and is_empty:
        raise ValueError(f"{address} {message.problem}")
    return message


def _typed_message(address: str, types: str, data: bytes, time_ns: int | None) -> OscMessage:
    """Return the message of the arguments in `data`, up to the first that cannot be read."""
    numbers: list[float] = []
    strings: list[str] = []
    problem = ""
    offset = 0
    for kind in types:
        try:
            value, offset = _parse_argument(kind, data, offset)
        except ValueError as error:
            problem = f"has {error}"
            break
        if isinstance(value, str):
            strings.append(value)
        elif value is not None:
            numbers.append(value)
    return OscMessage(address, tuple(numbers), time_ns, tuple(strings), problem)


def _parse_argument(kind: str, data: bytes, offset: int) -> tuple[float | str | None, int]:
    """Return the argument at `offset`, None if it is passed over, and where it ends.

    Raises:
        ValueError: If it is cut off, or its type is not known.
    """
    # Numbers, which are most of them
    value: float | str | None = _CONSTANTS.get(kind)
    if kind in _NUMBERS:
        number = data[offset : offset + _NUMBERS[kind].size]
        if len(number) < _NUMBERS[kind].size:
            raise ValueError("a cut-off argument")
        return float(_NUMBERS[kind].unpack(number)[0]), offset + len(number)

    # Strings, which may be numbers; all others only have a length
    if kind in "sS":
        text, offset = _parse_text(data, offset)
        try:
            value = float(text)
        except ValueError:
            value = text
    elif kind == "b":
        size = int.from_bytes(data[offset : offset + 4])
        offset += 4 + size + -size % 4
    elif kind not in _CONSTANTS and kind not in _SIZES:
        raise ValueError(f"an argument of the unknown type {kind!r}")
    offset += _SIZES.get(kind, 0)
    if offset > len(data) + 3:  # padding may be left out at the end
        raise ValueError("a cut-off argument")
    return value, offset


def _parse_text(data: bytes, offset: int) -> tuple[str, int]:
    """Return the string at `offset`, UTF-8 or else Latin-1, and where it ends with its padding."""
    end = data.find(b"\0", offset)
    if end < 0 or offset > len(data):
        raise ValueError("a string without an end")
    raw = data[offset:end]
    try:
        text = raw.decode()
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return text, end + 4 - (end - offset) % 4


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
        description="address of the messages with the orientation, such as /gyrosc/quat, or of four messages "
        "below it, w, x, y and z; if empty those of NGIMU, GyrOSC, ZIG SIM, Sensors2OSC and SceneRotator",
    )
    first: int = Field(
        default=0,
        ge=0,
        le=64,
        description="position of the quaternion's first number in messages of more than four numbers, from 1",
    )
    sensor_position: int | None = Field(
        default=None,
        ge=0,
        le=64,
        description="position of the number that names the sensor in such messages, from 1; 0: none does",
    )
    order: Literal["auto", "wxyz", "xyzw"] = Field(
        default="auto",
        description="order of the quaternion's numbers in a message; auto: that of the documented address",
    )

    @field_validator("address")
    @classmethod
    def _rooted(cls, value: str) -> str:
        if value and not value.startswith("/"):
            raise ValueError("must begin with /, such as /gyrosc/quat")
        return value

    @model_validator(mode="after")
    def _names_sensor(self) -> "OscConfig":
        if self.first and self.sensor_position is None:
            raise ValueError(
                "osc.first needs osc.sensor_position: the position of the number that names the sensor, "
                "from 1, or 0 if none does"
            )
        return self


class NamedReading(NamedTuple):
    """An orientation, and the names of its sensor."""

    reading: Reading
    names: tuple[str, ...]


class OscDecoder(Decoder):
    """Reads the messages of one device. Its rates are used until it sends an orientation."""

    def __init__(self, config: OscConfig) -> None:
        super().__init__(SensorChoice("osc.sensor", config.sensor_name))
        self._config = config
        self._has_orientation = False
        self._zig_sim = ""
        """Address of the orientations of a ZIG SIM that has introduced itself, or `""`."""
        self._components: dict[str, float] = {}
        """Components of a quaternion of four messages that is not complete."""
        self._battery: Battery | None = None

    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the readings and events of a datagram.

        Raises:
            ContentError: If it is not OSC, or its orientation is none.
        """
        messages, problem = parse(data)
        items: list[Item] = []
        senders = Counter[tuple[tuple[str, ...], int | None]]()
        for message in messages:
            try:
                item = self._decode_message(message, stamp_ns)
            except ContentError as error:
                problem = problem or f"{message.address} {error}"
                continue

            # Choose one sensor. Several orientations at one time are those of several sensors.
            if isinstance(item, NamedReading):
                self._has_orientation = True
                self.unused = ""
                sender = item.names, item.reading.device_time_ns
                senders[sender] += 1
                number = senders[sender]
                names = item.names
                if number > 1:
                    names = (" ".join((*names, f"{number}")),)
                item = item.reading if self.sensors.accepts(*names) else None
            if item is not None:
                items.append(item)

        # A partly readable datagram is used, and its problem reported
        if problem and not items:
            raise ContentError(problem)
        self.problem = problem or self.problem
        return items

    def _decode_message(self, message: OscMessage, stamp_ns: int) -> Item | NamedReading | None:
        """Return the orientation of `message`, or its other item, or None if it has none.

        Raises:
            ContentError: If it cannot be read.
        """
        address = message.address
        numbers = message.numbers

        # An orientation in one message, or one of the four messages that make it
        is_orientation = address == self._config.address
        if not self._config.address:
            is_orientation = self._is_documented(address)
        if is_orientation:
            return self._decode_orientation(message, stamp_ns)
        parent, _, last = address.rpartition("/")
        axis = component(last)[1]
        is_component = axis != "" and len(numbers) == 1
        if is_component and parent == self._config.address:
            return self._add_component(message, axis, stamp_ns)

        # Other content, as far as it is known
        has_rates = address == SENSORS and len(numbers) >= 6
        if has_rates and not self._has_orientation:
            rates = vector(numbers[0:3], math.radians(1.0))
            return RawReading(stamp_ns, rates, vector(numbers[3:6], GRAVITY_MPS2), message.time_ns)
        if address == "/battery" and len(numbers) >= 3:
            return self._changed_battery(numbers)
        if address.endswith("/deviceinfo"):
            self._zig_sim = f"{address.removesuffix('deviceinfo')}quaternion"
        if last == "button":
            is_pressed = not numbers or numbers[-1] > 0
            if not is_pressed or self._is_of_other(address):
                return None
            return Press(stamp_ns)

        # Anything else is explained as long as there is no orientation
        self.passed_over.add(address)
        if not self._has_orientation:
            addresses = ", ".join([*self.passed_over.counts][:MAX_SHOWN])
            self.unused = (
                f"gets messages ({addresses}), but none with a documented orientation: switch it on in the "
                f"app, or name the quaternion by {set_option('imu-bridge', 'osc.address', '/ADDRESS')} and "
                f"its order, xyzw or wxyz, by {ORDER_OPTION}"
            )
        return None

    def _decode_orientation(self, message: OscMessage, stamp_ns: int) -> NamedReading:
        numbers = message.numbers
        address = message.address

        # Its four numbers: at the configured position, or all of a message that is known to have no others
        first = self._config.first
        is_quaternion = address in ACCURATE or len(numbers) == 4
        if not first and is_quaternion:
            first = 1
        components = numbers[first - 1 : first + 3] if first else ()
        if len(components) < 4:
            hint = ""
            if len(numbers) >= 4:
                hint = (
                    ": give the positions, from 1, of the quaternion's first number and of the sensor's "
                    f"name, 0 if there is none, by {set_option('imu-bridge', 'osc.first', 2)} "
                    + set_option("imu-bridge", "osc.sensor_position", 0)
                )
            raise ContentError(message.problem or f"has {len(numbers)} numbers, 4 were expected{hint}")
        orientation_xyzw = unit_rotation(components, self._order(address))
        reading = Reading(stamp_ns, orientation_xyzw, message.time_ns)

        # The names of its sensor
        position = self._config.sensor_position or 0
        if position > len(numbers):
            raise ContentError(
                f"has {len(numbers)} numbers: name one of them, or 0, by "
                + set_option("imu-bridge", "osc.sensor_position", 0)
            )
        number = (f"{numbers[position - 1]:.9g}",) if position else ()
        return NamedReading(reading, (address, *message.strings, *number))

    def _add_component(self, message: OscMessage, axis: str, stamp_ns: int) -> NamedReading | None:
        components = self._components
        if axis in components:  # another was lost
            components.clear()
        components[axis] = message.numbers[0]
        if len(components) < 4:
            return None
        four = [components[name] for name in "xyzw"]
        components.clear()
        names = (self._config.address, *message.strings)
        reading = Reading(stamp_ns, unit_rotation(four, "xyzw"), message.time_ns)
        return NamedReading(reading, names)

    def _is_of_other(self, address: str) -> bool:
        """Return True if an event at `address` stands beside the orientation of another sensor only."""
        parent = address.rpartition("/")[0]
        others = {name.rpartition("/")[0] for name in self.sensors.others}
        if parent not in others:
            return False
        used = self.sensors.used or ""
        return parent != used.rpartition("/")[0]

    def _is_documented(self, address: str) -> bool:
        if address in ORDERS or address == self._zig_sim:
            return True
        return address.startswith(ZIG_SIM) and address.endswith("/quaternion")

    def _order(self, address: str) -> Order:
        """Return the order of the numbers at `address`.

        Raises:
            ContentError: If it is not documented.
        """
        if self._config.order != "auto":
            return self._config.order
        if not self._is_documented(address):
            raise ContentError(f"has numbers in an unknown order: give it, xyzw or wxyz, by {ORDER_OPTION}")
        return ORDERS.get(address, "xyzw")

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
