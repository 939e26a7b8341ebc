"""ROS values and their CDR: construction, encoding, decoding, type hashes."""

import json
import math
import struct
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys.base import normalize_fieldname

from pointit.bridges.ros2.graph.backend import Distro, RosType
from pointit.bridges.ros2.types.definitions import ARRAY, BASE, NAME, Definitions, Fields, Rihs01
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy

LayoutOf = Callable[[str], "Layout"]

Fault = Callable[[Any], str]

FEW = 64
"""Up to this many numbers a loop is faster than numpy."""


class Layout:
    """Makes and checks values of the type `name`; `layout_of` returns the layouts of nested types."""

    def __init__(self, name: str, definitions: Definitions, layout_of: LayoutOf) -> None:
        self.name = name
        self.cls = definitions.store.types[name]
        self._definitions = definitions
        self._layout_of = layout_of
        self._constant: dict[str, Any] = {}
        self._fresh: dict[str, Callable[[], Any]] = {}
        self._arrays: dict[str, np.dtype[Any]] = {}
        self._floats: list[str] = []
        self._faults: list[tuple[str, Callable[[Any], Any], Fault]] = []
        for field, of in self._fields(name):
            self._default(field, of)
        self._collect("", name)
        # Most fields are floats: one getter for all of them and one loop in C cost a tenth of separate ones.
        self._get_floats = attrgetter(*self._floats) if len(self._floats) > 1 else None
        if len(self._floats) == 1:
            self._faults.append((self._floats[0], attrgetter(self._floats[0]), of_float))

    def make(self, given: dict[str, Any]) -> Any:
        """Return a value with the fields `given`, and ROS's defaults for the others.

        Raises:
            ValueError: If a list of numbers does not fit its type.
            TypeError: If there is no such field.
        """
        values = {**self._constant, **given}
        for field, fresh in self._fresh.items():
            if field not in given:
                values[field] = fresh()
        for field, dtype in self._arrays.items():
            if field in given:
                values[field] = numbers(given[field], dtype, f"{self.name}.{field}")
        if len(values) > len(self._constant) + len(
            self._fresh
        ):  # rosbags' classes would accept constants, too
            unknown = given.keys() - self._constant.keys() - self._fresh.keys()
            raise TypeError(f"{self.name} has no field {', '.join(sorted(unknown))}")
        return self.cls(**values)

    def check(self, value: Any) -> None:
        """Check that `value` can be encoded.

        Raises:
            ValueError: If a field's value is invalid; names the field.
            AttributeError, TypeError, OverflowError: If it is no value of this type at all.
        """
        if self._get_floats is not None and not all(map(math.isfinite, self._get_floats(value))):
            for path, number in zip(self._floats, self._get_floats(value), strict=True):
                if fault := of_float(number):
                    raise ValueError(f"{self.name}.{path}: {fault}")
        for path, get, fault_in in self._faults:
            if fault := fault_in(get(value)):
                raise ValueError(f"{self.name}.{path}: {fault}")

    def _fields(self, name: str) -> list[tuple[str, Any]]:
        """Return the fields by the names that Python has for them (`from_` for `from`)."""
        return [(normalize_fieldname(field), of) for field, of in self._definitions.store.fielddefs[name][1]]

    def _collect(self, prefix: str, name: str) -> None:
        """Collect the checks, with those of nested types as if their fields were ours."""
        for field, of in self._fields(name):
            path = prefix + field
            shape, rest = of
            if shape == NAME:
                self._collect(f"{path}.", rest)
            elif shape == BASE and rest[0].startswith("float"):
                self._floats.append(path)
            elif fault := checker_for(of, lambda within: self._layout_of(within).check):
                self._faults.append((path, attrgetter(path), fault))

    def _default(self, field: str, of: Any) -> None:
        shape, rest = of
        if shape == BASE:
            zero = "" if rest[0] == "string" else dtype_of(rest[0]).type(0).item()
            self._constant[field] = self._definitions.defaults.get(self.name, {}).get(field, zero)
        elif shape == NAME:
            self._fresh[field] = partial(self._zero, rest)
        else:
            (shape_within, within), length = rest
            if shape != ARRAY:
                length = 0
            if shape_within == NAME:
                self._fresh[field] = partial(self._zeros, within, length)
            elif within[0] == "string":
                self._fresh[field] = partial(self._texts, length)
            else:
                self._arrays[field] = dtype_of(within[0])
                self._fresh[field] = partial(np.zeros, length, self._arrays[field])

    def _zero(self, within: str) -> Any:
        return self._layout_of(within).make({})

    def _zeros(self, within: str, length: int) -> list[Any]:
        return [self._zero(within) for _ in range(length)]

    def _texts(self, length: int) -> list[str]:
        return [""] * length


def numbers(given: Any, dtype: "np.dtype[Any]", where: str) -> "np.ndarray[Any, Any]":
    """Return `given` (bytes, a list, an array) as an array of `dtype`; only floats are rounded, to its width.

    Raises:
        ValueError: If they are no numbers in one row, or do not fit; begins with `where`.
    """
    if type(given) in {bytes, bytearray, memoryview} and dtype.itemsize == 1:
        return np.frombuffer(bytes(given), dtype)
    try:
        array = np.asarray(given if hasattr(given, "dtype") else list(given))
        with np.errstate(over="ignore", invalid="ignore"):  # caught by the comparison below, or by `check`
            cast = array if array.dtype == dtype else array.astype(dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{where}: are not numbers of type {dtype} ({error})") from error
    if cast.ndim != 1 or not (cast is array or dtype.kind == "f" or np.array_equal(cast, array)):
        raise ValueError(f"{where}: are not numbers of type {dtype} in one row")
    return np.ascontiguousarray(cast)


def checker_for(of: Any, check_of: Callable[[str], Callable[[Any], None]]) -> Fault | None:
    """Return a check of a field described by `of`, or None if the codec's suffices.

    The codec checks ranges of integers, lengths of arrays and that text is text. It does not check finite
    numbers, dtypes of arrays, NUL in text, booleans, and bounds. A check returns an error message, or `""`.

    Args:
        of: as `rihs01` describes fields; not a nested type.
        check_of: returns for a type's name a check that raises ValueError for bad values.
    """
    shape, rest = of
    if shape == BASE:
        base, bound = rest
        if base.startswith("float"):
            return of_float
        return partial(of_text, bound=bound) if base == "string" else of_bool if base == "bool" else None
    (shape_within, within), bound = rest
    if shape == ARRAY:
        bound = 0  # the codec checks the exact length
    if shape_within == NAME:
        return partial(of_values, bound=bound, check=check_of(within))
    if within[0] == "string":
        return partial(of_texts, bound=bound, text_bound=within[1])
    return partial(of_array, bound=bound, dtype=dtype_of(within[0]))


def dtype_of(base: str) -> "np.dtype[Any]":
    """Return numpy's dtype for a list of `base`."""
    return np.dtype({"byte": "int8", "char": "uint8"}.get(base, base))


def of_float(value: float) -> str:
    """Check that a number is finite."""
    return "" if math.isfinite(value) else f"{value!r} is not a finite number"


def of_bool(value: object) -> str:
    """Check a boolean."""
    return "" if isinstance(value, bool | np.bool_) else f"{value!r} is neither true nor false"


def of_text(value: object, *, bound: int) -> str:
    """Check text of at most `bound` bytes; 0 means unbounded, here and below."""
    if not isinstance(value, str):
        return f"{value!r} is not text"
    if "\0" in value:
        return f"{value!r} has a NUL inside, where ROS would end it"
    return of_length(value.encode(), bound) if bound else ""


def of_texts(values: Sequence[Any] | None, *, bound: int, text_bound: int) -> str:
    """Check a list of text."""
    if not isinstance(values, (list, tuple)):  # a text would be iterated letter by letter
        return f"a list of text was expected, got {type(values).__name__}"
    faults = (of_text(value, bound=text_bound) for value in values)
    return of_length(values, bound) or next(filter(None, faults), "")


def of_values(values: Sequence[Any], *, bound: int, check: Callable[[Any], None]) -> str:
    """Check a list of values of one type; errors of single values are raised."""
    if fault := of_length(values, bound):
        return fault
    for value in values:
        check(value)
    return ""


def of_array(values: Any, *, bound: int, dtype: "np.dtype[Any]") -> str:
    """Check an array of numbers."""
    if getattr(values, "dtype", None) != dtype or values.ndim != 1:
        return f"an array of {dtype} was expected, got {type(values).__name__}; `make` makes one"
    if dtype.kind != "f":
        return of_length(values, bound)
    finite = all(map(math.isfinite, values.tolist())) if len(values) <= FEW else np.isfinite(values).all()
    return of_length(values, bound) if finite else "has a number that is not finite"


def of_length(values: Sequence[Any], bound: int) -> str:
    """Check a length."""
    return f"is {len(values)} long, at most {bound} is allowed" if 0 < bound < len(values) else ""


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
