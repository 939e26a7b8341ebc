"""Names of rigid bodies in NatNet's lists of models. Pure."""

import struct

from pointit.bridges.mocap.natnet.packets import SIZED, MalformedPacketError, PacketReader, Version

_MARKER_SET, _RIGID_BODY, _SKELETON, _PLATE, _DEVICE, _CAMERA = range(6)
"""Kinds of models."""


def read_models(payload: bytes, version: Version) -> dict[int, str]:
    """Return the names of the rigid bodies by their ids.

    Raises:
        MalformedPacketError: If the list is damaged.
    """
    reader, names = PacketReader(payload), dict[int, str]()
    try:
        for _ in range(reader.count()):
            kind = reader.count(0)
            end = None
            if version >= SIZED:
                size = reader.count()
                end = reader.at + size
            if kind == _RIGID_BODY:
                name, number = _body_model(reader, version)
                names[number] = name
            elif end is None:
                _skip_model(reader, kind, version)
            if end is not None:
                reader.at = end
    except struct.error as error:
        raise MalformedPacketError(f"a list of models of {len(payload)} bytes ends early") from error
    return names


def _body_model(reader: PacketReader, version: Version) -> tuple[str, int]:
    name = reader.text()
    (number,) = struct.unpack_from("<i", reader.data, reader.at)
    reader.skip(20)
    if version >= (3, 0) and version < SIZED:
        count = reader.count(16)
        reader.skip(16 * count)
        for _ in range(count if version >= (4, 0) else 0):
            reader.text()
    return name, number


def _skip_model(reader: PacketReader, kind: int, version: Version) -> None:
    """Skip a model that is no body. Before 4.1 the layout of each kind must be known."""
    if kind == _MARKER_SET:
        reader.text()
        for _ in range(reader.count()):
            reader.text()
    elif kind == _SKELETON:
        reader.text()
        reader.skip(4)
        for _ in range(reader.count(20)):
            _body_model(reader, version)
    elif kind in (_PLATE, _DEVICE):
        reader.skip(4)
        reader.text()
        if kind == _PLATE:
            reader.skip(4 * (2 + 3 + 144 + 12))
        else:
            reader.text()
        reader.skip(8)
        for _ in range(reader.count()):
            reader.text()
    elif kind == _CAMERA:
        reader.text()
        reader.skip(28)
    else:
        raise MalformedPacketError(f"models of kind {kind} are unknown")
