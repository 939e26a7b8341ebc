"""Wrists that speak Open Sound Control: NGIMU, and apps of phones such as GyrOSC, ZIG SIM and Sensors2OSC."""

import math
from collections.abc import Sequence
from typing import Final, Literal

from pydantic import Field, field_validator

from pointit.services.imu_bridge.network.contents import DatagramError, orientation, vector
from pointit.services.imu_bridge.network.datagram_source import DatagramConfig, DatagramSource, Decoder
from pointit.services.imu_bridge.network.osc_message import OscMessage, parse_each
from pointit.services.imu_bridge.reading import Battery, Item, Press, RawReading, Reading
from pointit.services.imu_bridge.serial.fifth_number import FifthNumber, is_unit
from pointit.services.imu_bridge.sources import ImuSource
from pointit.services.imu_bridge.streams.json_content import Order
from pointit.services.imu_bridge.streams.sensor_choice import SensorChoice

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
MOST_SHOWN = 4
"""Number of addresses without an orientation that a warning names."""


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


def several_quaternions(numbers: Sequence[float]) -> list[tuple[Sequence[float], str]]:
    """Return the quaternions of a message with those of several sensors, or with one behind a position.

    Each comes with the number of its sensor: the one in front of it, else its position in the message from 1.
    Empty if the numbers are of another kind.
    """
    for start, size in ((0, 4), (1, 5), (0, 5)):
        groups = [numbers[at : at + size] for at in range(0, len(numbers), size)]
        fours = [group[start : start + 4] for group in groups]
        if len(groups) < 2 or len(numbers) % size or not all(map(is_unit, fours)):
            continue
        fronts = {group[0] for group in groups}
        has_numbers = start > 0 and len(fronts) == len(groups) and all(each == round(each) for each in fronts)
        names = [f"{group[0]:.9g}" if has_numbers else f"{n}" for n, group in enumerate(groups, 1)]
        return [*zip(fours, names, strict=True)]
    if len(numbers) >= 9 and len(numbers) % 4 == 1:  # a time or count in front
        return several_quaternions(numbers[1:])
    if len(numbers) == 7 and is_unit(numbers[3:]) and not is_unit(numbers[:4]):
        return [(numbers[3:], "")]
    return []


class OscDecoder(Decoder):
    """Reads the messages of one device. Its rates are used until it sends an orientation."""

    def __init__(self, config: OscConfig) -> None:
        super().__init__(SensorChoice("osc.sensor", config.sensor_name))
        self._config = config
        self._has_orientation = False
        self._zig_sim = ""
        """Address of the orientations of a ZIG SIM that has introduced itself, or `""`."""
        self._fifth = FifthNumber()
        self._battery: Battery | None = None
        self._addresses: dict[str, None] = {}
        """Addresses of messages that were not used."""

    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the readings and events of a datagram.

        Raises:
            DatagramError: If it is not OSC, or its orientation is none.
        """
        messages, problem = parse_each(data)
        items: list[Item] = []
        for message in messages:
            try:
                item = self._item(message, stamp_ns)
            except DatagramError as error:
                problem = problem or f"{message.address} {error}"
            else:
                items += [] if item is None else [item]
        if problem and not items:
            raise DatagramError(problem)
        self.problem = problem or self.problem
        return items

    def _item(self, message: OscMessage, stamp_ns: int) -> Item | None:
        address, numbers = message.address, message.numbers
        if self._is_orientation(address):
            return self._reading(message, stamp_ns)
        if address == SENSORS and len(numbers) >= 6 and not self._has_orientation:
            rates = vector(numbers[0:3], math.radians(1.0))
            return RawReading(stamp_ns, rates, vector(numbers[3:6], GRAVITY_MPS2), message.time_ns)
        if address == "/battery" and len(numbers) >= 3:
            return self._changed_battery(numbers)
        if address.endswith("/deviceinfo"):
            self._zig_sim, self.doubt = f"{address.removesuffix('deviceinfo')}quaternion", ""
        if address.rpartition("/")[2] == "button":
            is_pressed = not numbers or numbers[-1] > 0
            return Press(stamp_ns) if is_pressed and not self._is_of_other(address) else None
        if not self._has_orientation and len(self._addresses) < MOST_SHOWN:
            self._addresses[address] = None
            self.unused = (
                f"gets messages ({', '.join(self._addresses)}), but none with a quaternion: switch it on in "
                "the app, or set osc.address"
            )
        return None

    def _reading(self, message: OscMessage, stamp_ns: int) -> Reading | None:
        """Return the orientation in `message`, or None if it is of another sensor, or has none.

        Raises:
            DatagramError: If it cannot be read.
        """
        numbers = message.numbers
        if len(numbers) < 4:
            reason = message.problem or f"has {len(numbers)} numbers, 4 were expected"
            self.problem = f"{message.address} {reason}"
            return None
        quaternions = several_quaternions(numbers)
        if not quaternions and len(numbers) > 4:
            split = self._fifth.split(numbers[:5], is_behind=message.types[:1] == message.types[1:2])
            if split is None:
                return None
            quaternions = [(split[0], split[1])]
        reading: Reading | None = None
        for four, name in quaternions or [(numbers, "")]:
            turned = orientation(four, self._order(message.address))
            self._has_orientation, self.unused = True, ""
            if self.sensors.accepts(message.address, *message.strings, name) and reading is None:
                reading = Reading(stamp_ns, turned, message.time_ns)
        return reading

    def _is_of_other(self, address: str) -> bool:
        """Return True if an event at `address` stands beside the orientation of another sensor only."""
        place = address.rpartition("/")[0]
        others = {each.rpartition("/")[0] for each in self.sensors.others}
        return place in others and place != (self.sensors.used or "").rpartition("/")[0]

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
