"""Output to Art-Net nodes: DMX universes over UDP by Art-Net 4, and the search for nodes.

No core: it waits for datagrams and time.
"""

import ipaddress
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pydantic import Field

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.datagram_search import MAX_FOUND, search_by_datagrams
from pointit.runtime.errors import ConfigError
from pointit.runtime.host import extras
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas.printable import plain
from pointit.services.led_driver.output.udp_output import (
    Datagram,
    Destination,
    DmxOutput,
    UdpOutputConfig,
    Universe,
)
from pointit.services.led_driver.outputs import LedOutput

PORT = 6454
MAX_PORT_ADDRESS = 0x7FFF
"""Highest universe: 7 bits of net, 4 of sub-net, 4 of universe."""
_HEAD = b"Art-Net\0"
_VERSION = 14
_POLL = 0x2000
_POLL_REPLY = 0x2100
_DMX = 0x5000
_SYNC = 0x5200
_COMMAND = struct.Struct("<8sH")
"""Identifier and operation, of every packet."""
_REPLY = struct.Struct("<8sH4sH2xBB6x18s64s64sxB4s4s4s4s4s")
"""Reply of a node up to the universes of its outputs."""
_IS_OUTPUT = 0x80
"""Bit of a port's type: it sends what it receives by Art-Net to lights."""


@dataclass(frozen=True, slots=True)
class ArtnetNode:
    """A node that has answered a search."""

    address: str
    """IPv4 address."""
    name: str
    report: str
    """State of the node as it reports it, or `""`."""
    universes: tuple[int, ...]
    """Port addresses of its outputs."""


def dmx_packet(port_address: int, sequence: int, slots: bytes) -> bytes:
    """Return the packet that sets a universe.

    Args:
        port_address: universe, 0 to 32767.
        sequence: number of the packet in its universe; sent as 1 to 255, because 0 turns ordering off.
        slots: values from the first slot on, at most 512. An odd number gets one more, 0.
    """
    slots += bytes(len(slots) % 2)
    command = _COMMAND.pack(_HEAD, _DMX)
    version_and_sequence = struct.pack(">HBB", _VERSION, sequence % 255 + 1, 0)
    universe = struct.pack("<H", port_address)
    size = struct.pack(">H", len(slots))
    return command + version_and_sequence + universe + size + slots


def sync_packet() -> bytes:
    """Return the packet at which nodes show all universes that they have received."""
    return _COMMAND.pack(_HEAD, _SYNC) + struct.pack(">HH", _VERSION, 0)


def poll_packet() -> bytes:
    """Return the packet that nodes answer with their name and universes."""
    return _COMMAND.pack(_HEAD, _POLL) + struct.pack(">HBB", _VERSION, 0, 0)


def read_reply(packet: bytes) -> ArtnetNode | None:
    """Return the node that sent `packet`, or None if it is no answer to a search."""
    if len(packet) < _REPLY.size:
        return None
    head, operation, address, _, net, subnet, short, long, report, count, kinds, _, _, _, outputs = (
        _REPLY.unpack_from(packet)
    )
    if head != _HEAD or operation != _POLL_REPLY:
        return None

    # All outputs of a reply are in one sub-net
    base = (net & 0x7F) << 8 | (subnet & 0x0F) << 4
    universes: list[int] = []
    for port in range(min(count, len(kinds))):
        if kinds[port] & _IS_OUTPUT:
            universes.append(base | outputs[port] & 0x0F)
    dotted_address = ".".join(str(byte) for byte in address)
    name = _text(long) or _text(short)
    return ArtnetNode(address=dotted_address, name=name, report=_text(report), universes=tuple(universes))


def _text(field: bytes) -> str:
    """Return the printable characters before the first zero."""
    text = field.partition(b"\0")[0].decode("ascii", errors="replace")
    return plain(text).strip()


async def find_nodes(seconds: float) -> Sequence[FoundDevice]:
    """Return the nodes that answer within `seconds`.

    Raises:
        ConfigError: If the question cannot be sent.
    """
    nodes: dict[str, ArtnetNode] = {}

    def read(data: bytes, _address: str) -> FoundDevice | None:
        node = read_reply(data)
        if node is None:
            return None
        if len(nodes) >= MAX_FOUND and node.address not in nodes:
            return None
        merge_reply(nodes, node)
        return _device(nodes[node.address])

    targets = [(address, PORT) for address in broadcast_addresses()]
    return await search_by_datagrams(
        "Art-Net nodes", seconds, targets, lambda _port: poll_packet(), read, port=PORT
    )


def merge_reply(nodes: dict[str, ArtnetNode], node: ArtnetNode) -> None:
    """Add `node` to the nodes by address. A node with more than four ports replies once for each four."""
    known = nodes.setdefault(node.address, node)
    universes = tuple(sorted({*known.universes, *node.universes}))
    nodes[node.address] = replace(known, universes=universes, name=known.name or node.name)


def broadcast_addresses() -> list[str]:
    """Return the broadcast address of each network that this machine is in, without its own loopback.

    Raises:
        ConfigError: If an extra is missing.
    """
    try:
        import ifaddr  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ConfigError(
            f"Art-Net nodes cannot be searched without the extra `discovery`; {extras.remedy('discovery')} "
            "installs it"
        ) from error
    addresses: list[str] = []
    for adapter in ifaddr.get_adapters():
        for ip in adapter.ips:
            if not ip.is_IPv4:
                continue
            interface = ipaddress.IPv4Interface(f"{ip.ip}/{ip.network_prefix}")
            if not interface.is_loopback:
                addresses.append(str(interface.network.broadcast_address))
    return addresses


def _device(node: ArtnetNode) -> FoundDevice:
    numbers = sorted(set(node.universes))
    universes = ", ".join(str(number) for number in numbers)
    name = node.name or "Art-Net node"
    outputs = f"universes {universes}" if universes else "no outputs"
    details: dict[str, str | float] = {"universes": universes, "report": node.report}
    return FoundDevice(node.address, f"{name}, {outputs}", details)


class ArtnetConfig(UdpOutputConfig):
    """A node of Art-Net."""

    kind: str = Field(default="artnet", description="kind of controller")
    host: str = Field(default="", description="name or address of the node, broadcast address, or HOST:PORT")
    port: int = Field(default=PORT, gt=0, le=65535, description="UDP port of the node")
    universe: int = Field(
        default=0,
        ge=0,
        le=MAX_PORT_ADDRESS,
        description="first port address (net · 256 + sub-net · 16 + universe): 170 RGB or 128 RGBW pixels",
    )


class ArtnetStream:
    """Packets to one node, or to all of a network."""

    def __init__(self, host: str, port: int) -> None:
        self.destination = Destination(host=host, port=port, is_broadcast=True)

    def frame(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes`; several are shown at once, by ArtSync."""
        packets = [Datagram(dmx_packet(universe, number, slots)) for universe, slots in universes]
        if len(packets) > 1:
            packets.append(Datagram(sync_packet()))
        return packets

    def end(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes` for the last time."""
        return self.frame(universes, number)


def make_artnet(config: ArtnetConfig, surroundings: Surroundings) -> DmxOutput:
    """Return the output; nothing is opened yet."""
    stream = ArtnetStream(config.host, config.port)
    return DmxOutput(config, surroundings, stream, config.universe)


ARTNET = LedOutput(
    summary="Art-Net nodes: pixel controllers, DMX nodes",
    config=ArtnetConfig,
    make=make_artnet,
    argument="host",
    divided_by="universe",
    example="ADDRESS",
    discover=find_nodes,
)
