"""Bytes of E1.31 (streaming ACN, sACN): DMX universes over UDP. Pure; ANSI E1.31-2018."""

import struct
from dataclasses import dataclass
from uuid import UUID

PORT = 5568
MIN_UNIVERSE, MAX_UNIVERSE = 1, 63999
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
_ROOT_DATA, _FRAMING_DATA = 4, 2
_DMP_SET_PROPERTY, _DMP_ADDRESSES = 0x02, 0xA1
_FLAGS = 0x7000
_STREAM_TERMINATED = 0x40
_NAME_BYTES = 63


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
        sender: who sends it.
        universe: number of the universe, 1 to 63999.
        sequence: number of the packet in its universe, of which the lowest byte is sent.
        slots: values from the first slot on, at most 512.
        ended: True in the last `END_PACKETS` packets of a stream.
    """
    size = HEADER_BYTES + len(slots)
    name = sender.name.encode()[:_NAME_BYTES].decode(errors="ignore").encode()
    root = _ROOT.pack(
        _PREAMBLE_BYTES, 0, _IDENTIFIER, _length(size - _PREAMBLE_BYTES), _ROOT_DATA, sender.cid.bytes
    )
    options = _STREAM_TERMINATED if ended else 0
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
    dmp = _DMP.pack(
        _length(size - _ROOT.size - _FRAMING.size),
        _DMP_SET_PROPERTY,
        _DMP_ADDRESSES,
        0,
        1,
        len(slots) + 1,
        0,  # start code of levels
    )
    return root + framing + dmp + slots


def _length(size: int) -> int:
    return _FLAGS | size
