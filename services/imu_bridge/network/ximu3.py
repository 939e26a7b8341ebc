"""An x-IMU3 in the network: messages by UDP, and its announcements.

No core: it waits for datagrams.
"""

import asyncio
import json
import math
from collections.abc import Sequence
from typing import Self

from pydantic import Field, model_validator

from pointit.runtime.clock import Clock
from pointit.runtime.config.parameters import set_option
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.service.plugin_guard import HealthSink
from pointit.schemas import Feedback
from pointit.services.imu_bridge.network.datagram_source import DatagramConfig, DatagramSource, Decoder
from pointit.services.imu_bridge.network.udp_server import ANY_HOST, Address, receive_shared
from pointit.services.imu_bridge.serial.framers import FLASH_S
from pointit.services.imu_bridge.serial.ximu3 import Ximu3Framer
from pointit.services.imu_bridge.sources import ImuSource, Item
from pointit.services.imu_bridge.streams import ContentError, SensorChoice

ANNOUNCEMENTS = 10000
"""UDP port to which each device announces itself once a second."""
LONGEST_DATAGRAM = 1500
MAX_MESSAGES = 64
MAX_FOUND = 64
"""Number of devices that a search remembers."""


class Ximu3Config(DatagramConfig):
    """An x-IMU3 that sends by UDP."""

    port: int = Field(
        default=8000,
        ge=1,
        le=65535,
        description="UDP port to which the device sends, its `udpSend`; each person has another",
    )
    sensor: str = Field(
        default="", description="IP address of the device; the first that sends something readable if empty"
    )
    commands: int = Field(
        default=9000, ge=1, le=65535, description="UDP port of the device for commands, its `udpReceive`"
    )

    @model_validator(mode="after")
    def _is_address(self) -> Self:
        if self.sensor_name:
            raise ValueError("sensor: must be an IP address; leave it empty for the first that sends")
        return self


class Ximu3Decoder(Decoder):
    """Reads the datagrams of one device, each of which holds whole messages."""

    def __init__(self) -> None:
        super().__init__(SensorChoice("ximu3.sensor"))
        self.framer = Ximu3Framer()
        self.passed_over = self.framer.passed_over

    def items(self, data: bytes, stamp_ns: int) -> Sequence[Item]:
        """Return the items of a datagram.

        Raises:
            ContentError: If nothing in it can be read, or if it is too long.
        """
        messages = data.rstrip(b"\n").split(b"\n")
        if len(data) > LONGEST_DATAGRAM or len(messages) > MAX_MESSAGES:
            raise ContentError(
                f"has {len(data)} bytes and {len(messages)} messages, more than {LONGEST_DATAGRAM} or "
                f"{MAX_MESSAGES}"
            )
        bad_before = self.framer.bad
        items = self.framer.feed(b"\n".join(messages) + b"\n", stamp_ns)
        if self.passed_over.count:
            self.unused = (
                f"gets messages that have no orientation ({self.passed_over.text}): {self.framer.MISSING}"
            )
        if self.framer.bad > bad_before and not items:
            raise ContentError(self.framer.reason)
        return items


class Ximu3Source(DatagramSource):
    """Passes the readings of one device on, and shows cues by its LED."""

    def __init__(self, config: Ximu3Config, clock: Clock, health: HealthSink) -> None:
        super().__init__("ximu3", config, Ximu3Decoder, clock, health)
        self._commands = config.commands

    def cue(self, cue: Feedback) -> None:
        """Flash the LED of the device for `cue`, if one is connected."""
        begin, end = Ximu3Framer().cue(cue)
        if begin and self._read_s is not None:
            self._send(begin)
            asyncio.get_running_loop().call_later(FLASH_S, self._send, end)

    def _send(self, command: bytes) -> None:
        used = self._senders.used
        if used is not None:
            self._server.send(command, (used[0], self._commands))


def announced(data: bytes, host: str) -> FoundDevice | None:
    """Return the device that announces itself by `data` from the address `host`, or None if none does."""
    try:
        content = json.loads(data)
        name = str(content["name"])[:40]
        number = str(content.get("sn", content.get("serial", "")))[:40]
        battery = float(content["battery"])
        port = float(content["send"])
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    if not (math.isfinite(battery) and math.isfinite(port)):
        return None
    option = set_option("imu-bridge", "ximu3.host", ANY_HOST)
    label = f"{name} {number}, battery {battery:.0f} %; it sends to UDP port {port:.0f}; {option}"
    return FoundDevice(host, label, {"serial_number": number, "battery_percent": battery, "port": port})


async def discover(seconds: float) -> Sequence[FoundDevice]:
    """Return the devices that announce themselves.

    Raises:
        ConfigError: If the port of announcements is taken by a program that does not share it.
    """
    devices: dict[str, FoundDevice] = {}

    def on_datagram(data: bytes, address: Address) -> None:
        device = announced(data, address[0])
        if device is not None and len(devices) < MAX_FOUND:
            devices[device.address] = device

    await receive_shared(ANNOUNCEMENTS, seconds, on_datagram, remedy="end the x-IMU3 program that has it")
    return [devices[address] for address in sorted(devices)]


XIMU3 = ImuSource(
    summary="an x-IMU3 in the network, by UDP; on a cable it is a serial device",
    config=Ximu3Config,
    make=lambda config, around: Ximu3Source(config, around.clock, around.health),
    argument="sensor",
    argument_optional=True,
    example="192.168.1.20",
    discover=discover,
)
