"""Output to WLED and other pixel controllers by DDP, the Distributed Display Protocol.

A packet is flags, sequence, data type, id, offset (4 bytes) and size (2 bytes) of its data, the data.

No core: it sends datagrams.
"""

import asyncio
import contextlib
import json
import struct
from collections.abc import Sequence
from typing import Any, cast

from pydantic import Field

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.host.name_lookup import NetworkService, browse, look_up
from pointit.schemas.text import one_line
from pointit.services.led_driver.output.udp_output import Datagram, UdpOutput, UdpOutputConfig
from pointit.services.led_driver.outputs import LedOutput

PORT = 4048
MAX_DATA_BYTES = 1440
"""Limit of the data of a packet, bytes: 480 pixels of three colours, 360 of four."""
VERSION = 0x40
PUSH = 0x01
DATA_TYPES = {3: 0x0B, 4: 0x1B}
"""Red, green, blue, and the same with white, 8 bits each."""
DEFAULT_ID = 1
SEQUENCES = 15
"""Sequence numbers go from 1 to this one. 0 is for packets without."""
SEQUENCED_PACKETS = 10
"""Limit of packets in a frame with sequence numbers. WLED would take later ones for late ones of the frame
before."""
_HEADER = struct.Struct(">BBBBIH")

SERVICE = "_wled._tcp"
ANSWER_S = 1.0
"""Maximum time for the description of a controller, s."""
MAX_INFO_BYTES = 65536
MAX_WORD = 64
"""Characters of a controller's name and version that are shown."""
MAX_PIXELS = 65536
"""Largest number of pixels that a controller is believed to have."""


def encode_frame(pixels: bytes, colors: int, number: int) -> list[bytes]:
    """Return the packets that show `pixels`. The last one makes the controller show all.

    Args:
        pixels: bytes of the output, `colors` a pixel.
        colors: 3, or 4 with white.
        number: number of the frame, from 1.
    """
    starts = range(0, len(pixels), MAX_DATA_BYTES)
    first = (number - 1) * len(starts)
    is_sequenced = len(starts) <= SEQUENCED_PACKETS
    packets: list[bytes] = []
    for index, start in enumerate(starts):
        data = pixels[start : start + MAX_DATA_BYTES]
        is_last = index == len(starts) - 1
        flags = VERSION | PUSH if is_last else VERSION
        sequence = (first + index) % SEQUENCES + 1 if is_sequenced else 0
        header = _HEADER.pack(flags, sequence, DATA_TYPES[colors], DEFAULT_ID, start, len(data))
        packets.append(header + data)
    return packets


async def find_wled(seconds: float) -> Sequence[FoundDevice]:
    """Return the WLED controllers that are found in a number of seconds.

    Raises:
        ConfigError: If the extra `discovery` is missing.
    """
    services = await browse(SERVICE, seconds)
    return await asyncio.gather(*(_describe(service) for service in services))


async def _describe(service: NetworkService) -> FoundDevice:
    host = service.address
    if await _is_resolved(service.host):
        host = service.host
    info = await read_info(service.address, service.port)
    return described(host, service.name, info)


async def _is_resolved(host: str) -> bool:
    """Return True if this machine finds the address of `host`, which many do not for `.local`."""
    if not host:
        return False
    try:
        async with asyncio.timeout(ANSWER_S / 2):
            await look_up(host)
    except OSError:  # TimeoutError is one
        return False
    return True


async def read_info(address: str, port: int) -> object:
    """Return the controller's description of itself, or None.

    Reads at most `MAX_INFO_BYTES` within `ANSWER_S`, follows no redirect and uses no proxy.
    """
    answer = b""
    with contextlib.suppress(OSError):  # TimeoutError is one
        async with asyncio.timeout(ANSWER_S):
            reader, writer = await asyncio.open_connection(address, port)
            try:
                writer.write(f"GET /json/info HTTP/1.0\r\nHost: {address}\r\n\r\n".encode())
                while part := await reader.read(MAX_INFO_BYTES - len(answer)):
                    answer += part
            finally:
                writer.transport.abort()
    head, _, body = answer.partition(b"\r\n\r\n")
    status = head.split(b" ")[1:2]
    if status != [b"200"]:
        return None
    try:
        return json.loads(body)
    except (ValueError, RecursionError):
        return None


def described(host: str, name: str, info: object) -> FoundDevice:
    """Return the controller at `host`, given its `/json/info`, which may be anything."""
    values = _mapping(info)
    pixels = _mapping(values.get("leds")).get("count")
    own_name = _word(values.get("name"))
    version = _word(values.get("ver"))

    # Only what is plausible is shown
    words = [own_name or name]
    details: dict[str, str | float] = {}
    if type(pixels) is int and 0 < pixels <= MAX_PIXELS:
        details["pixels"] = pixels
        words.append(f"{pixels} pixels")
    if version:
        details["version"] = version
        words.append(f"WLED {version}")
    return FoundDevice(host, ", ".join(words), details)


def _mapping(value: object) -> dict[str, Any]:
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


def _word(value: object) -> str:
    return one_line(value, MAX_WORD) if isinstance(value, str) else ""


class DdpConfig(UdpOutputConfig):
    """A pixel controller in the network that takes DDP, such as WLED."""

    kind: str = Field(default="ddp", description="kind of controller")
    port: int = Field(default=PORT, gt=0, le=65535, description="UDP port of the controller")
    max_rate_hz: float = Field(
        default=66.0, gt=0, le=1000, description="maximum number of frames per second; WLED shows up to 66"
    )


class DdpOutput(UdpOutput):
    """Sends frames to one controller."""

    def encode(self, pixels: bytes, number: int) -> Sequence[Datagram]:
        """Return the packets that show `pixels`."""
        return [Datagram(data) for data in encode_frame(pixels, self.pixel_map.colors, number)]


DDP = LedOutput(
    summary="a pixel controller in the network: WLED, xLights (DDP)",
    config=DdpConfig,
    make=DdpOutput,
    argument="host",
    divided_by="port",
    example="HOST",
    discover=find_wled,
)
