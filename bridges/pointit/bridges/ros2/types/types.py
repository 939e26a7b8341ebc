"""ROS values and their CDR: construction, encoding, decoding, type hashes."""

import json
import struct
from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError

from pointit.bridges.ros2.graph.backend import Distro, RosType
from pointit.bridges.ros2.types.definitions import Definitions
from pointit.bridges.ros2.types.layout import Layout
from pointit.bridges.ros2.types.rihs01 import Fields, Rihs01
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy

NO_HASH = "TypeHashNotSupported"
"""Humble's text in place of a hash."""

GOLDEN = Path(__file__).parent / "golden.json"
"""Hashes of a running ROS 2, by type; Jazzy and Kilted agree on all of them."""

HEADER_BYTES = 4

MAX_BYTES = 1_000_000


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
        self._golden: dict[str, str] = json.loads(GOLDEN.read_text(encoding="utf-8"))
        self._layouts: dict[str, Layout] = {}
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
            is_service = name in self._definitions.services
            for part in (self.request_of(name), self.response_of(name)) if is_service else (name,):
                self._layout(part)
                self._store.get_msgdef(part)

    def make(self, name: str, /, **fields: Any) -> Any:
        """Return a value of the message type `name`; fields not given have ROS's defaults.

        Lists of numbers are given as lists, arrays or, for single bytes, as bytes.

        Raises:
            KeyError: as `kind`.
            TypeError: If the type has no such field.
            ValueError: If a list of numbers does not fit its type; `encode` finds what else does not.
        """
        return self._layout(name).make(fields)

    def encode(self, name: str, value: Any) -> bytes:
        """Return `value` as CDR, little endian, with its header.

        Raises:
            KeyError: as `kind`.
            ValueError: If it is no value of this type, does not fit it (range, length, type), or has a
                number that is not finite or text with a NUL inside.
        """
        layout = self._layout(name)
        codec = self._store.get_msgdef(name)
        if not isinstance(value, layout.cls):
            raise ValueError(f"{name}: got a value of type {type(value).__name__}")  # noqa: TRY004  # one kind for all
        try:
            layout.check(value)
            cdr = bytearray(HEADER_BYTES + codec.getsize_cdr(0, value, self._store))
            cdr[1] = 1
            end = codec.serialize_cdr_le(memoryview(cdr)[HEADER_BYTES:], 0, value, self._store)
        except (SerdeError, struct.error, ValueError, TypeError, AttributeError, OverflowError) as error:
            raise ValueError(f"{name}: cannot be encoded ({error})") from error
        if end + HEADER_BYTES != len(cdr):
            raise ValueError(f"{name}: cannot be encoded (a list is not of its type)")
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
            raise ValueError(f"{name}: is not CDR, begins with {cdr[:4].hex(' ') or 'nothing'}")
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

    def verify(self) -> None:
        """Compare every type whose hash in a running ROS 2 is known.

        Raises:
            ConfigError: If one differs.
        """
        for name in self._golden:
            if name in self._definitions.services or name in self._store.fielddefs:
                self.kind(name)

    def _hash(self, name: str) -> str:
        if name not in self._definitions.services:
            self._layout(name)
        if self.distro == "humble":
            return NO_HASH
        is_service = name in self._definitions.services
        computed = self._rihs01.service(name) if is_service else self._rihs01.message(name)
        if (expected := self._golden.get(name, computed)) != computed:
            raise ConfigError(
                f"{name}: the hash of its definition is {computed}, in ROS 2 it is {expected}; remove "
                f"this Python environment, make it again and run {remedy('ros2')}"
            )
        return computed

    def _half(self, service: str, half: str) -> str:
        if service not in self._definitions.services:
            raise KeyError(f"{service} is not a service the bridge knows")
        return f"{service}_{half}"

    def _layout(self, name: str) -> Layout:
        known = self._layouts.get(name)
        if known is not None:
            return known
        if name not in self._store.fielddefs:
            raise KeyError(f"{name} is not a type that ROS 2 {self.distro} or PointIt defines")
        self._layouts[name] = Layout(name, self._definitions, self._layout)
        return self._layouts[name]

    def _fields_of(self, name: str) -> Fields:
        return self._store.fielddefs[name][1]
