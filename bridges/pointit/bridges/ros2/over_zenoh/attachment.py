"""What rmw_zenoh attaches to every sample, request and reply; without it, or with another, ROS nodes fail."""

import struct
from dataclasses import dataclass

GID_BYTES = 16

_FORMAT = struct.Struct("<qqB16s")


@dataclass(frozen=True, kw_only=True, slots=True)
class Attachment:
    """Who sent it, when, and which of theirs it is."""

    sequence: int
    """1 for an endpoint's first, and so on; with `gid` it names a request."""
    stamp_ns: int
    """When it was sent, of the system clock."""
    gid: bytes
    """The 16 bytes of the endpoint's token; a reply bears those of the request."""


def packed(attachment: Attachment) -> bytes:
    """Return its 33 bytes.

    Raises:
        ValueError: a number does not fit in 64 bits, or the gid is not 16 bytes long.
    """
    if len(attachment.gid) != GID_BYTES:
        raise ValueError(f"a gid of {len(attachment.gid)} bytes, {GID_BYTES} are needed")
    try:
        return _FORMAT.pack(attachment.sequence, attachment.stamp_ns, GID_BYTES, attachment.gid)
    except struct.error as error:
        raise ValueError(f"{attachment} does not fit ({error})") from error


def unpacked(data: bytes) -> Attachment:
    """Return what is attached.

    Raises:
        ValueError: it is not 33 bytes that say so of themselves.
    """
    if len(data) != _FORMAT.size:
        raise ValueError(f"an attachment of {len(data)} bytes, rmw_zenoh's has {_FORMAT.size}")
    sequence, stamp_ns, length, sender = _FORMAT.unpack(data)
    if length != GID_BYTES:
        raise ValueError(f"an attachment with a gid of {length} bytes, rmw_zenoh's has {GID_BYTES}")
    return Attachment(sequence=sequence, stamp_ns=stamp_ns, gid=sender)
