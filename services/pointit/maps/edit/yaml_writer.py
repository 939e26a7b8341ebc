"""Writes names and values as YAML that readers of YAML 1.1 and 1.2 read as the same."""

import re
from typing import Any, cast

import yaml

from pointit.runtime.config.yaml_values import Loader, WrittenFloat, WrittenInt

_PLAIN = re.compile(r"\w(?:[\w. /-]*\w)?", re.ASCII)

_Dumper: Any = type("Dumper", (getattr(yaml, "CSafeDumper", yaml.SafeDumper),), {})
"""Puts text in quotes that is another value in YAML 1.1, which PyYAML reads, or in 1.2, which we read."""


def quoted(text: str) -> str:
    """Return `text` as a YAML scalar on one line, quoted if YAML 1.1 or 1.2 would read another value."""
    if _PLAIN.fullmatch(text) and dump_yaml([text], default_flow_style=True) == f"[{text}]\n":
        return text
    return dump_yaml(text, default_style='"', width=2**30).rstrip("\n")


def dump_yaml(data: object, **style: Any) -> str:
    """Return `data`, such as a result of `read_yaml`, as YAML with the same names and values."""
    text: str = cast("Any", yaml).dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, **style)
    return text


def _represent(dumper: Any, value: WrittenInt | WrittenFloat) -> Any:
    kind = "int" if isinstance(value, int) else "float"
    return dumper.represent_scalar(f"tag:yaml.org,2002:{kind}", value.text)


for _letter, _rows in Loader.yaml_implicit_resolvers.items():
    for _tag, _pattern in _rows:
        _Dumper.add_implicit_resolver(_tag, _pattern, [_letter])
_Dumper.add_representer(WrittenInt, _represent)
_Dumper.add_representer(WrittenFloat, _represent)
