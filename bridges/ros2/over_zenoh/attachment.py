"""Attachment of rmw_zenoh to each message: its origin, time and number."""

import struct
from dataclasses import dataclass

GID_BYTES = 16

_FORMAT = struct.Struct("<qqB16s")


@dataclass(frozen=True, kw_only=True, slots=True)
class Attachment:
    """Origin of a message: endpoint, time and number."""

    sequence: int
    """1 for an endpoint's first message, and so on; with `gid` it identifies a request."""
    stamp_ns: int
    """Time of sending, by the system clock."""
    gid: bytes
    """The 16 bytes of the endpoint's token. A reply has those of the request."""


def packed(attachment: Attachment) -> bytes:
    """Return its 33 bytes."""
    return _FORMAT.pack(attachment.sequence, attachment.stamp_ns, GID_BYTES, attachment.gid)


def unpacked(data: bytes | None) -> Attachment:
    """Return the attachment in `data`, which may be foreign.

    Raises:
        ValueError: If it is none: not 33 bytes with a matching length field.
    """
    if data is None:
        raise ValueError("they have no attachment, so no node of rmw_zenoh has sent them")
    if len(data) != _FORMAT.size:
        sizes = f"{len(data)} bytes, rmw_zenoh's has {_FORMAT.size}"
        raise ValueError(f"an attachment of {sizes}: update ros-*-rmw-zenoh-cpp there")
    sequence, stamp_ns, length, sender = _FORMAT.unpack(data)
    if length != GID_BYTES:
        raise ValueError(f"an attachment with a gid of {length} bytes, rmw_zenoh's has {GID_BYTES}")
    return Attachment(sequence=sequence, stamp_ns=stamp_ns, gid=sender)
