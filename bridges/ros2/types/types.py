"""ROS values and their CDR: construction, encoding, decoding, type hashes."""

import json
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys.base import normalize_fieldname

from pointit.bridges.ros2.graph.backend import Distro, RosType
from pointit.bridges.ros2.types.definitions import ARRAY, BASE, NAME, Definitions, Fields, Rihs01
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy

LayoutOf = Callable[[str], "MessageLayout"]

NO_HASH = "TypeHashNotSupported"
"""Humble's text in place of a hash."""

GOLDEN = Path(__file__).parent / "golden.json"
"""Hashes of a running ROS 2, by type; Jazzy and Kilted agree on all of them."""

HEADER_BYTES = 4

MAX_BYTES = 1_000_000


class MessageLayout:
    """Makes values of the type `name`; `layout_of` returns the layouts of nested types."""

    def __init__(self, name: str, definitions: Definitions, layout_of: LayoutOf) -> None:
        self.name = name
        self._class = definitions.store.types[name]
        self._defaults = definitions.defaults.get(name, {})
        self._layout_of = layout_of
        self._constant: dict[str, Any] = {}
        self._fresh: dict[str, Callable[[], Any]] = {}
        self._arrays: dict[str, np.dtype[Any]] = {}
        for field, of in definitions.store.fielddefs[name][1]:
            self._default(normalize_fieldname(field), of)  # as Python has it: `from_` for `from`

    def make(self, given: dict[str, Any]) -> Any:
        """Return a value with the fields `given`, and ROS's defaults for the others.

        Raises:
            TypeError: If there is no such field.
        """
        values = {**self._constant, **given}
        for field, fresh in self._fresh.items():
            if field not in given:
                values[field] = fresh()
        for field, dtype in self._arrays.items():
            if field in given:
                values[field] = _numbers(given[field], dtype)
        return self._class(**values)

    def _default(self, field: str, of: Any) -> None:
        shape, rest = of
        if shape == BASE:
            zero: Any = ""
            if rest[0] != "string":
                zero = _dtype_of(rest[0]).type(0).item()
            self._constant[field] = self._defaults.get(field, zero)
        elif shape == NAME:
            self._fresh[field] = partial(self._zero, rest)
        else:
            (shape_within, within), length = rest
            if shape != ARRAY:
                length = 0
            if shape_within == NAME:
                self._fresh[field] = partial(self._zeros, within, length)
            elif within[0] == "string":
                self._fresh[field] = lambda: [""] * length
            else:
                dtype = _dtype_of(within[0])
                self._arrays[field] = dtype
                self._fresh[field] = partial(np.zeros, length, dtype)

    def _zero(self, within: str) -> Any:
        return self._layout_of(within).make({})

    def _zeros(self, within: str, length: int) -> list[Any]:
        return [self._zero(within) for _ in range(length)]


def _numbers(given: Any, dtype: "np.dtype[Any]") -> "np.ndarray[Any, Any]":
    """Return `given` (bytes, a list, an array) as an array of `dtype`, which the codec copies unchecked."""
    if isinstance(given, bytes):
        return np.frombuffer(given, dtype)
    return np.ascontiguousarray(given, dtype)


def _dtype_of(base: str) -> "np.dtype[Any]":
    """Return numpy's dtype for a list of `base`."""
    return np.dtype({"byte": "int8", "char": "uint8"}.get(base, base))


class Types:
    """The types of one distribution and ours; built once, when the bridge starts.

    A value is a plain object with the definition's fields as attributes (a dataclass of rosbags): numbers,
    `str`, lists, and numpy arrays for lists of numbers; constants of the definition are attributes too. Types
    are called `package/msg/Name`, `package/srv/Name`, and a service's halves `package/srv/Name_Request` and
    `package/srv/Name_Response`.
    """

    def __init__(self, distro: Distro) -> None:
        self.distro: Distro = distro
        self._definitions = Definitions(distro)
        self._store = self._definitions.store
        self._rihs01 = Rihs01(self._fields_of)
        golden = GOLDEN.read_text(encoding="utf-8")
        self._golden: dict[str, str] = json.loads(golden)
        self._layouts: dict[str, MessageLayout] = {}
        self._kinds: dict[str, RosType] = {}

    def kind(self, name: str) -> RosType:
        """Return the message or service type `name` with its hash.

        Raises:
            KeyError: If there is no such type; its argument is a sentence.
            ConfigError: If its hash is not the one of a running ROS 2, so ROS nodes would see nothing of it.
        """
        if name not in self._kinds:
            self._kinds[name] = RosType(name=name, hash=self._hash(name))
        return self._kinds[name]

    def prepare(self, *names: str) -> None:
        """Generate the codecs of these types or services now (1 to 30 ms each), not with their first message.

        Raises:
            KeyError, ConfigError: as `kind`.
        """
        for name in names:
            self.kind(name)
            parts: tuple[str, ...] = (name,)
            if name in self._definitions.services:
                parts = (self.request_of(name), self.response_of(name))
            for part in parts:
                self._layout(part)
                self._store.get_msgdef(part)

    def make(self, name: str, /, **fields: Any) -> Any:
        """Return a value of the message type `name`; fields not given have ROS's defaults.

        Lists of numbers are given as lists, arrays or, for single bytes, as bytes.

        Raises:
            KeyError: as `kind`.
            TypeError: If the type has no such field.
        """
        return self._layout(name).make(fields)

    def encode(self, name: str, value: Any) -> bytes:
        """Return `value` as CDR, little endian, with its header.

        Raises:
            KeyError: as `kind`.
            ValueError: If it does not fit its type: range, length, type.
        """
        codec = self._store.get_msgdef(self._layout(name).name)
        try:
            cdr = bytearray(HEADER_BYTES + codec.getsize_cdr(0, value, self._store))
            cdr[1] = 1
            codec.serialize_cdr_le(memoryview(cdr)[HEADER_BYTES:], 0, value, self._store)
        except (SerdeError, struct.error, ValueError, TypeError, AttributeError, OverflowError) as error:
            raise ValueError(f"{name}: cannot be encoded ({error})") from error
        return bytes(cdr)

    def decode(self, name: str, cdr: bytes, *, max_bytes: int = MAX_BYTES) -> Any:
        """Return the value in `cdr`; what follows it is padding and ignored.

        Nothing is allocated that the bytes at hand could not fill. Numbers may be infinite or NaN, as in ROS.

        Raises:
            KeyError: as `kind`.
            ValueError: If it is longer than `max_bytes`, is not plain CDR, or does not hold such a value.
        """
        codec = self._store.get_msgdef(self._layout(name).name)
        if len(cdr) > max_bytes:
            raise ValueError(f"{name}: {len(cdr)} bytes, at most {max_bytes} are read")
        if cdr[:2] == b"\x00\x01":
            deserialize = codec.deserialize_cdr_le
        elif cdr[:2] == b"\x00\x00":
            deserialize = codec.deserialize_cdr_be
        else:
            head = cdr[:4].hex(" ") or "nothing"
            raise ValueError(f"{name}: is not CDR, begins with {head}")
        try:
            value, _ = deserialize(cdr[HEADER_BYTES:], 0, codec.cls, self._store)
        except (SerdeError, struct.error, ValueError, TypeError, IndexError, OverflowError) as error:
            raise ValueError(f"{name}: cannot be decoded ({error})") from error
        return value

    def request_of(self, service: str) -> str:
        """Return the message type of the requests to `service`.

        Raises:
            KeyError: as `kind`.
        """
        return self._half(service, "Request")

    def response_of(self, service: str) -> str:
        """Return the message type of the responses of `service`.

        Raises:
            KeyError: as `kind`.
        """
        return self._half(service, "Response")

    def _hash(self, name: str) -> str:
        if name not in self._definitions.services:
            self._layout(name)
        if self.distro == "humble":
            return NO_HASH
        is_service = name in self._definitions.services
        computed = self._rihs01.service(name) if is_service else self._rihs01.message(name)
        expected = self._golden.get(name, computed)
        if expected != computed:
            raise ConfigError(
                f"{name}: the hash of its definition is {computed}, in ROS 2 it is {expected}; remove "
                f"this Python environment, make it again and run {remedy('ros2')}"
            )
        return computed

    def _half(self, service: str, half: str) -> str:
        if service not in self._definitions.services:
            raise KeyError(f"{service} is not a service the bridge knows")
        return f"{service}_{half}"

    def _layout(self, name: str) -> MessageLayout:
        layout = self._layouts.get(name)
        if layout is not None:
            return layout
        if name not in self._store.fielddefs:
            raise KeyError(f"{name} is not a type that ROS 2 {self.distro} or PointIt defines")
        self._layouts[name] = MessageLayout(name, self._definitions, self._layout)
        return self._layouts[name]

    def _fields_of(self, name: str) -> Fields:
        return self._store.fielddefs[name][1]
