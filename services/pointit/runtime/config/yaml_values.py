"""Values of YAML files: those of YAML 1.2, with their text, which may be a name."""

import re
from typing import Any, TypeVar

import yaml

T = TypeVar("T", int, float)
MAX_YAML_INT = 1000
"""Characters of a whole number: Python does not show those with some thousands of digits."""

Loader: Any = type(
    "Loader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {"yaml_implicit_resolvers": {}}
)
"""The one in C where PyYAML has it, a large map in a second instead of ten; with values as here."""

_TAG = "tag:yaml.org,2002:"
MERGE, TEXT = f"{_TAG}merge", f"{_TAG}str"
_DISPUTED = f"{_TAG}disputed"
"""Text that is a truth value, a number or a date in YAML 1.1 only: `on`, `12:30`, `2026-11-26`."""
_DIGITS = "+-.0123456789"
_RESOLVERS = (
    ("bool", "tf", "true|false"),
    ("str", "TF", "True|TRUE|False|FALSE"),  # no value of Python keeps its text
    ("null", ("~", "n", "N", ""), "~|null|Null|NULL|"),
    ("merge", "<", "<<"),
    ("int", _DIGITS, "[-+]?(0b[01][01_]*|0o[0-7][0-7_]*|0x[0-9a-fA-F][0-9a-fA-F_]*|[0-9][0-9_]*)"),
    ("float", _DIGITS, r"[-+]?(\.[0-9][0-9_]*|[0-9][0-9_]*(\.[0-9_]*)?)([eE][-+]?[0-9]+)?"),
    ("float", _DIGITS, r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"),
)
"""Values of plain text: tag, first letters, pattern."""
_TRUE, _FALSE = ("yes", "on", "y", "true"), ("no", "off", "n", "false")
FLAGS = dict.fromkeys(_TRUE, "true") | dict.fromkeys(_FALSE, "false")
"""Words of YAML 1.1 in lower case. All but `true` and `false` are text, which a bool field understands."""
_DISPUTED_NUMBER = re.compile(r"[-+]?(0b|0o|0+([1-9][0-9]|[89])[0-9]*\Z)|.*_")
_BASES = {"0b": 2, "0o": 8, "0x": 16}


class YamlContentError(yaml.YAMLError):
    """Problem of valid YAML, and its node."""


class _Written:
    text: str

    def __repr__(self) -> str:
        return self.text


class WrittenInt(_Written, int):
    """A whole number with its text in the file, which may be a name: `010`."""


class WrittenFloat(_Written, float):
    """A number with its text in the file, which may be a name: `1.10`."""


def written_text(value: object) -> object:
    """Return the text in the file of `value` if it is a number, true or false, else `value`."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value) if isinstance(value, int | float) else value


def disputes_of(loader: Any) -> list[tuple[int, str]]:
    """Return lines and warnings about the values of `loader` that are others in YAML 1.1."""
    disputes: list[tuple[int, str]] = loader.__dict__.setdefault("disputes", [])
    return disputes


def _note_dispute(loader: Any, node: yaml.ScalarNode, remedy: str) -> None:
    warning = f'readers of YAML disagree about {node.value}{remedy} "{node.value}" for text'
    disputes_of(loader).append((node.start_mark.line + 1, warning))


def _int(loader: Any, node: yaml.ScalarNode) -> int:
    if len(node.value) > MAX_YAML_INT:
        raise YamlContentError(f"a number has more than {MAX_YAML_INT} digits; write text in quotes", node)
    digits = node.value.replace("_", "").lower()
    value = int(digits, _BASES.get(digits.lstrip("+-")[:2], 10))
    return _written(loader, node, value, WrittenInt)


def _float(loader: Any, node: yaml.ScalarNode) -> float:
    value = float(node.value.replace("_", "").lower().replace(".inf", "inf").replace(".nan", "nan"))
    return _written(loader, node, value, WrittenFloat)


def _written(loader: Any, node: yaml.ScalarNode, value: T, kind: Any) -> T:
    if str(value) == node.value:
        return value
    if _DISPUTED_NUMBER.match(node.value):
        _note_dispute(loader, node, f", as a number {value} here; write {value}, or")
    written: T = kind(value)
    vars(written)["text"] = node.value
    return written


def _disputed_text(loader: Any, node: yaml.ScalarNode) -> str:
    flag = FLAGS.get(node.value.lower())
    _note_dispute(loader, node, f"; write {flag}, or" if flag else "; write")
    return str(node.value)


def _add_resolvers() -> None:
    for name, first, pattern in _RESOLVERS:
        Loader.add_implicit_resolver(_TAG + name, re.compile(rf"(?:{pattern})\Z"), first)
    for letter, rows in yaml.SafeLoader.yaml_implicit_resolvers.items():
        for tag, pattern in rows:
            if tag.removeprefix(_TAG) in ("bool", "int", "float", "timestamp"):
                Loader.add_implicit_resolver(_DISPUTED, pattern, [letter])


_add_resolvers()
Loader.add_constructor(f"{_TAG}int", _int)
Loader.add_constructor(f"{_TAG}float", _float)
Loader.add_constructor(_DISPUTED, _disputed_text)
Loader.add_constructor(MERGE, Loader.construct_scalar)
