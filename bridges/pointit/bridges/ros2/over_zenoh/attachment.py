"""Attachment of rmw_zenoh to every sample, request and reply; ROS nodes fail without it or with another."""

import struct
from dataclasses import dataclass

GID_BYTES = 16

OLD_FIELDS = (b"source_gid", b"sequence_number")
"""Field names of attachments before Humble 0.1.2 and Jazzy 0.2.4."""

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
    """Return its 33 bytes.

    Raises:
        ValueError: If a number does not fit in 64 bits, or the gid is not 16 bytes long.
    """
    if len(attachment.gid) != GID_BYTES:
        raise ValueError(f"a gid of {len(attachment.gid)} bytes, {GID_BYTES} are needed")
    try:
        return _FORMAT.pack(attachment.sequence, attachment.stamp_ns, GID_BYTES, attachment.gid)
    except struct.error as error:
        raise ValueError(f"{attachment} does not fit ({error})") from error


def unpacked(data: bytes | None) -> Attachment:
    """Return the attachment in `data`, which may be foreign.

    Raises:
        ValueError: If it is none: not 33 bytes with a matching length field.
    """
    if data is None:
        raise ValueError("they have no attachment, so no node of rmw_zenoh has sent them")
    if any(field in data for field in OLD_FIELDS):
        raise ValueError(
            "their attachment is of an rmw_zenoh before 0.1.2 (Humble) or 0.2.4 (Jazzy), whose nodes and "
            "newer ones crash each other; update ros-*-rmw-zenoh-cpp there"
        )
    if len(data) != _FORMAT.size:
        raise ValueError(f"an attachment of {len(data)} bytes, rmw_zenoh's has {_FORMAT.size}")
    sequence, stamp_ns, length, sender = _FORMAT.unpack(data)
    if length != GID_BYTES:
        raise ValueError(f"an attachment with a gid of {length} bytes, rmw_zenoh's has {GID_BYTES}")
    return Attachment(sequence=sequence, stamp_ns=stamp_ns, gid=sender)
