"""Packets of E1.31 as the package sacn, an independent implementation, reads them. It has no types."""

import importlib
from typing import Any, NamedTuple

_data_packet: Any = importlib.import_module("sacn.messages.data_packet")


class SacnPacket(NamedTuple):
    cid: bytes
    universe: int
    priority: int
    sequence: int
    ended: bool
    slots: bytes
    """All 512; those that were not sent are 0."""


def read_packet(packet: bytes) -> SacnPacket:
    """Return the content of `packet`. Raises TypeError if it is none of E1.31's data."""
    read = _data_packet.DataPacket.make_data_packet(packet)
    return SacnPacket(
        cid=bytes(read.cid), universe=read.universe, priority=read.priority, sequence=read.sequence,
        ended=read.option_StreamTerminated, slots=bytes(read.dmxData),
    )  # fmt: skip
