"""Bytes of Art-Net 4: DMX universes over UDP, and the search for nodes. Pure."""

import struct
from dataclasses import dataclass

PORT = 6454
MAX_PORT_ADDRESS = 0x7FFF
"""Highest universe: 7 bits of net, 4 of sub-net, 4 of universe."""
_HEAD = b"Art-Net\0"
_VERSION = 14
_POLL, _POLL_REPLY, _DMX, _SYNC = 0x2000, 0x2100, 0x5000, 0x5200
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
    head = _COMMAND.pack(_HEAD, _DMX)
    return (
        head
        + struct.pack(">HBB", _VERSION, sequence % 255 + 1, 0)
        + struct.pack("<H", port_address)
        + struct.pack(">H", len(slots))
        + slots
    )


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
    base = (net & 0x7F) << 8 | (subnet & 0x0F) << 4
    ports = range(min(count, len(kinds)))
    return ArtnetNode(
        address=".".join(str(byte) for byte in address),
        name=_text(long) or _text(short),
        report=_text(report),
        universes=tuple(base | outputs[port] & 0x0F for port in ports if kinds[port] & _IS_OUTPUT),
    )


def _text(field: bytes) -> str:
    """Return the printable characters before the first zero."""
    text = field.partition(b"\0")[0].decode("ascii", errors="replace")
    return "".join(each if each.isprintable() else "?" for each in text).strip()
