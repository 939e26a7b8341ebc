"""Defaults and checks of ROS values of one type."""

import math
from collections.abc import Callable
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
from rosbags.typesys.base import normalize_fieldname

from pointit.bridges.ros2.types.definitions import Definitions
from pointit.bridges.ros2.types.field_checks import Fault, checker_for, dtype_of, of_float
from pointit.bridges.ros2.types.rihs01 import ARRAY, BASE, NAME

LayoutOf = Callable[[str], "Layout"]


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
        """Set the default of `field`."""
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
