"""ROS values: as plain Python, of any type for property tests, and as captured of a running ROS 2."""

import json
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from hypothesis import strategies as st

from pointit.bridges.ros2.types.definitions import ARRAY, BASE, NAME, SEQUENCE, Definitions, Fields
from tests.unit.ros2.scenes import jazzy

TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12)
FIELDS = {name: fields for name, (_, fields) in Definitions("jazzy").store.fielddefs.items()}


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


Strategies = Mapping[str, st.SearchStrategy[Any]]


def any_value(name: str, instead: Strategies = MappingProxyType({})) -> st.SearchStrategy[Any]:
    """Values of the type `name`; types in `instead` are drawn from there."""
    if name in instead:
        return instead[name]
    given = {field: any_field(of, instead) for field, of in FIELDS[name]}
    return st.fixed_dictionaries(given).map(lambda each: jazzy().make(name, **each))


def any_field(of: Any, instead: Strategies) -> st.SearchStrategy[Any]:
    shape, rest = of
    if shape == NAME:
        return any_value(rest, instead)
    if shape == BASE:
        return instead[rest[0]] if rest[0] in instead else any_base(rest[0])
    within, count = rest
    return st.lists(any_field(within, instead), min_size=count if shape == ARRAY else 0, max_size=count or 4)


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
    return st.integers(limits.min, limits.max)


FOLDER = Path(__file__).parent / "golden"
LINE = re.compile(r"([\w/]+)(?:<=(\d+))?(\[(<=)?(\d*)\])? (\w+)(?: .*)?")


def golden(name: str) -> Any:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def definitions() -> dict[str, Fields]:
    """Fields of types that rosbags does not bring, so that their hashes can be compared, too."""
    return {name: [field(line) for line in lines] for name, lines in golden("definitions").items()}


def field(line: str) -> tuple[str, Any]:
    """A line of a definition as `rihs01` describes fields; a reader of its own, so that two must agree."""
    found = LINE.fullmatch(line)
    assert found is not None, line
    kind, text_bound, listed, at_most, count, name = found.groups()
    of: Any = (NAME, kind.replace("/", "/msg/")) if "/" in kind else (BASE, (kind, int(text_bound or 0)))
    if listed:
        of = (ARRAY if count and not at_most else SEQUENCE, (of, int(count or 0)))
    return name, of
