"""Checks of ROS values that the codec omits and whose failure harms readers.

The codec itself checks ranges of integers, lengths of arrays and that text is text. It does not check finite
numbers, dtypes of arrays, NUL in text, booleans, and bounds. Every function here takes a field's value first
and returns an error message, or `""`.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pointit.bridges.ros2.types.rihs01 import ARRAY, BASE, NAME

Fault = Callable[[Any], str]

FEW = 64
"""Up to this many numbers a loop is faster than numpy."""


def checker_for(of: Any, check_of: Callable[[str], Callable[[Any], None]]) -> Fault | None:
    """Return a check of a field described by `of`, or None if the codec's suffices.

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
