"""Defaults and checks of ROS values of one type."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
from rosbags.typesys.base import normalize_fieldname

from pointit.bridges.ros2.types.definitions import Definitions
from pointit.bridges.ros2.types.rihs01 import ARRAY, BASE, NAME

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
    if not isinstance(values, list | tuple):  # a text would be iterated letter by letter
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
