"""Output to receivers of E1.31 (sACN): DMX universes over UDP by ANSI E1.31-2018.

No core: it sends datagrams.
"""

import ipaddress
import struct
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self
from uuid import UUID

from pydantic import Field, model_validator

from pointit.runtime.machine import this_machine
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.services.led_driver.output.udp_output import (
    Datagram,
    Destination,
    DmxOutput,
    UdpOutputConfig,
    Universe,
)
from pointit.services.led_driver.outputs import LedOutput

PORT = 5568
MIN_UNIVERSE = 1
MAX_UNIVERSE = 63999
DEFAULT_PRIORITY = 100
HEADER_BYTES = 126
"""Bytes before the slots, with the start code."""
END_PACKETS = 3
"""Number of packets that say that a stream has ended (6.2.6)."""
_ROOT = struct.Struct(">HH12sHI16s")
_FRAMING = struct.Struct(">HI64sBHBBH")
_DMP = struct.Struct(">HBBHHHB")
_PREAMBLE_BYTES = 16
_IDENTIFIER = b"ASC-E1.17\0\0\0"
_ROOT_DATA = 4
_FRAMING_DATA = 2
_DMP_SET_PROPERTY = 0x02
_DMP_ADDRESSES = 0xA1
_FLAGS = 0x7000
_STREAM_TERMINATED = 0x40
_NAME_BYTES = 63

MULTICAST = "multicast"
"""Value of `host` that means the multicast group of each universe."""


@dataclass(frozen=True, slots=True)
class E131Sender:
    """Identity of a sender, the same in all its packets."""

    cid: UUID
    """Component identifier. Receivers merge senders that differ in it."""
    name: str
    """Name that consoles and receivers show, cut to 63 bytes."""
    priority: int = DEFAULT_PRIORITY
    """Priority, 0 to 200. Receivers obey the sender with the highest one."""


def multicast_address(universe: int) -> str:
    """Return the multicast group of a universe."""
    return f"239.255.{universe >> 8}.{universe & 0xFF}"


def data_packet(
    sender: E131Sender, universe: int, sequence: int, slots: bytes, *, ended: bool = False
) -> bytes:
    """Return the packet that sets a universe.

    Args:
        sender: identity of the sender.
        universe: number of the universe, 1 to 63999.
        sequence: number of the packet in its universe, of which the lowest byte is sent.
        slots: values from the first slot on, at most 512.
        ended: True in the last `END_PACKETS` packets of a stream.
    """
    # Root layer (5): each layer states the size of the packet from its own start to the end
    size = HEADER_BYTES + len(slots)
    root = _ROOT.pack(
        _PREAMBLE_BYTES,
        0,
        _IDENTIFIER,
        _length(size - _PREAMBLE_BYTES),
        _ROOT_DATA,
        sender.cid.bytes,
    )

    # Framing layer (6): a name that is cut within a character loses the whole character
    options = _STREAM_TERMINATED if ended else 0
    cut_name = sender.name.encode()[:_NAME_BYTES]
    name = cut_name.decode(errors="ignore").encode()
    framing = _FRAMING.pack(
        _length(size - _ROOT.size),
        _FRAMING_DATA,
        name,
        sender.priority,
        0,  # not synchronized
        sequence & 0xFF,
        options,
        universe,
    )

    # DMP layer (7): the values, preceded by the start code
    dmp_size = size - _ROOT.size - _FRAMING.size
    values = len(slots) + 1
    start_code = 0  # of levels
    dmp = _DMP.pack(_length(dmp_size), _DMP_SET_PROPERTY, _DMP_ADDRESSES, 0, 1, values, start_code)
    return root + framing + dmp + slots


def _length(size: int) -> int:
    return _FLAGS | size


class E131Config(UdpOutputConfig):
    """A receiver of E1.31 (sACN)."""

    kind: str = Field(default="e131", description="kind of controller")
    host: str = Field(
        default="", description="name or address of the receiver, HOST:PORT, or `multicast` for a network"
    )
    port: int = Field(default=PORT, gt=0, le=65535, description="UDP port of the receiver")
    interface: str = Field(
        default="", description="IPv4 address of this machine in the network that gets the multicast"
    )
    universe: int = Field(
        default=1, ge=MIN_UNIVERSE, le=MAX_UNIVERSE, description="first universe: 170 RGB or 128 RGBW pixels"
    )
    priority: int = Field(
        default=DEFAULT_PRIORITY, ge=0, le=200, description="priority; receivers obey the highest"
    )

    @model_validator(mode="after")
    def _has_interface(self) -> Self:
        check_interface(self.host, self.interface)
        return self


def check_interface(host: str, interface: str) -> None:
    """Check that multicast has an interface. Raises ValueError if not."""
    if interface:
        try:
            ipaddress.IPv4Address(interface)
        except ValueError as error:
            raise ValueError(
                f"interface: {interface!r} is not an IPv4 address of this machine, which multicast needs"
            ) from error
    elif host == MULTICAST:
        raise ValueError("interface: multicast needs the address of this machine in the lights' network")


class E131Stream:
    """Packets to one receiver, or to the groups of all."""

    def __init__(
        self, destination: Destination, first_universe: int, priority: int = DEFAULT_PRIORITY
    ) -> None:
        """Prepare. `destination`: its host may be `MULTICAST`."""
        self._is_multicast = destination.host == MULTICAST
        self.destination = destination
        if self._is_multicast:
            self.destination = Destination(host="", port=destination.port, interface=destination.interface)
        # the same after a restart, so that receivers do not merge a stream with its own past
        stream = f"{this_machine().host_name} {destination.host} {first_universe}"
        cid = uuid.uuid5(uuid.NAMESPACE_DNS, stream)
        self._sender = E131Sender(cid, "PointIt", priority)

    def frame(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes`."""
        return self._packets(universes, number, ended=False)

    def end(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes`, and end their streams."""
        packets = self._packets(universes, number, ended=False)
        for later in range(1, END_PACKETS + 1):
            packets += self._packets(universes, number + later, ended=True)
        return packets

    def _packets(self, universes: Sequence[Universe], number: int, *, ended: bool) -> list[Datagram]:
        datagrams: list[Datagram] = []
        for universe, slots in universes:
            data = data_packet(self._sender, universe, number, slots, ended=ended)
            host = multicast_address(universe) if self._is_multicast else None
            datagrams.append(Datagram(data, host))
        return datagrams


def make_e131(config: E131Config, surroundings: Surroundings) -> DmxOutput:
    """Return the output; nothing is opened yet."""
    destination = Destination(host=config.host, port=config.port, interface=config.interface)
    stream = E131Stream(destination, config.universe, config.priority)
    return DmxOutput(config, surroundings, stream, config.universe)


E131 = LedOutput(
    summary="receivers of E1.31 (sACN): pixel controllers, WLED, DMX nodes",
    config=E131Config,
    make=make_e131,
    argument="host",
    divided_by="universe",
    example="ADDRESS",
)
