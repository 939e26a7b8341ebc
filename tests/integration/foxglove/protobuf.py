"""Protobuf as its specification has it, read by the descriptors that a server advertises.

Written here, so that what the SDK writes is read by somebody else.
"""

import struct
from typing import Any, Protocol

from foxglove import Schema

DOUBLE = 1
FIXED32 = 7
BOOL = 8
STRING = 9
MESSAGE = 11
BYTES = 12
ENUM = 14
REPEATED = 3

# of descriptor.proto: number -> (name, type, repeated, message)
_BOOTSTRAP: dict[str, dict[int, tuple[str, int, bool, str]]] = {
    "set": {1: ("file", MESSAGE, True, "file")},
    "file": {2: ("package", STRING, False, ""), 4: ("message_type", MESSAGE, True, "message")},
    "message": {
        1: ("name", STRING, False, ""),
        2: ("field", MESSAGE, True, "field"),
        3: ("nested_type", MESSAGE, True, "message"),
    },
    "field": {
        1: ("name", STRING, False, ""),
        3: ("number", ENUM, False, ""),
        4: ("label", ENUM, False, ""),
        5: ("type", ENUM, False, ""),
        6: ("type_name", STRING, False, ""),
    },
}


class Reader:
    """Reads messages of the types in a FileDescriptorSet; fields at their default are absent."""

    def __init__(self, descriptors: bytes) -> None:
        self._types = dict(_BOOTSTRAP)
        for file in self._read("set", descriptors)["file"]:
            for message in file.get("message_type", []):
                self._learn(f".{file.get('package', '')}", message)

    def read(self, name: str, payload: bytes) -> dict[str, Any]:
        return self._read(f".{name}", payload)

    def _learn(self, scope: str, message: dict[str, Any]) -> None:
        name = f"{scope}.{message['name']}"
        self._types[name] = {
            each["number"]: (each["name"], each["type"], each["label"] == REPEATED, each.get("type_name", ""))
            for each in message.get("field", [])
        }
        for nested in message.get("nested_type", []):
            self._learn(name, nested)

    def _read(self, kind: str, payload: bytes) -> dict[str, Any]:
        found: dict[str, Any] = {}
        at = 0
        while at < len(payload):
            tag, at = _varint(payload, at)
            wire = tag & 7
            value: Any
            if wire == 0:
                value, at = _varint(payload, at)
            elif wire == 1:
                value = struct.unpack_from("<d", payload, at)[0]
                at = at + 8
            elif wire == 5:
                value = payload[at : at + 4]
                at = at + 4
            elif wire == 2:
                length, at = _varint(payload, at)
                value = payload[at : at + length]
                at = at + length
                assert len(value) == length, "cut off"
            else:
                raise AssertionError(f"wire type {wire}")
            if (tag >> 3) not in self._types[kind]:
                assert kind in _BOOTSTRAP, f"{kind} has no field {tag >> 3}"
                continue
            name, type_, repeated, inner = self._types[kind][tag >> 3]
            values = self._values(type_, wire, value, inner)
            if repeated:
                found.setdefault(name, []).extend(values)
            else:
                found[name] = values[-1]
        return found

    def _values(self, type_: int, wire: int, value: Any, inner: str) -> list[Any]:
        if type_ == MESSAGE:
            return [self._read(inner, value)]
        if type_ == STRING:
            return [value.decode()]
        if wire == 5:
            return list(struct.unpack("<I" if type_ == FIXED32 else "<f", value))
        if type_ == BYTES or wire != 2:
            return [bool(value) if type_ == BOOL else value]
        if type_ in (DOUBLE, FIXED32):
            code, size = ("d", 8) if type_ == DOUBLE else ("I", 4)
            return list(struct.unpack(f"<{len(value) // size}{code}", value))
        packed: list[int] = []
        at = 0
        while at < len(value):
            number, at = _varint(value, at)
            packed.append(number)
        return packed


def _varint(payload: bytes, at: int) -> tuple[int, int]:
    number = shift = 0
    while True:
        byte = payload[at]
        number |= (byte & 0x7F) << shift
        at = at + 1
        shift = shift + 7
        if byte < 0x80:
            return number, at


class Encodable(Protocol):
    """A message of the SDK."""

    @staticmethod
    def get_schema() -> Schema: ...

    def encode(self) -> bytes: ...


def read(message: Encodable) -> dict[str, Any]:
    """Content of a message of the SDK."""
    schema = message.get_schema()
    return Reader(schema.data).read(schema.name, message.encode())
