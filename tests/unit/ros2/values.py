"""ROS values as plain Python, and values of any type for property tests."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

from pointit.bridges.ros2.types.rihs01 import ARRAY, BASE, NAME, Fields
from pointit.bridges.ros2.types.types import Types

TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12)


def plain(value: Any) -> Any:
    """Structures as dicts without constants (which are written large), arrays as lists."""
    if is_dataclass(value):
        names = (each.name for each in fields(value))
        return {
            name: plain(getattr(value, name)) for name in names if name == name.lower() and name[:2] != "__"
        }
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value if isinstance(value, str | int | float) else [plain(each) for each in value]


def any_value(types: Types, fields_of: Mapping[str, Fields], name: str) -> st.SearchStrategy[Any]:
    """Values of the type `name`."""
    given = {field: any_field(types, fields_of, of) for field, of in fields_of[name]}
    return st.fixed_dictionaries(given).map(lambda each: types.make(name, **each))


def any_field(types: Types, fields_of: Mapping[str, Fields], of: Any) -> st.SearchStrategy[Any]:
    shape, rest = of
    if shape == NAME:
        return any_value(types, fields_of, rest)
    if shape == BASE:
        return any_base(rest[0])
    within, count = rest
    return st.lists(
        any_field(types, fields_of, within), min_size=count if shape == ARRAY else 0, max_size=count or 4
    )


def any_base(base: str) -> st.SearchStrategy[Any]:
    if base == "bool":
        return st.booleans()
    if base == "string":
        return TEXT
    if base.startswith("float"):
        width: Any = int(base[5:])
        return st.floats(allow_nan=False, allow_infinity=False, width=width)
    base = {"byte": "int8", "char": "uint8"}.get(base, base)
    limits = np.iinfo(base)
    return st.integers(int(limits.min), int(limits.max))
