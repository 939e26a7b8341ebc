"""Edits of the text of a map: only the characters of changed values, names and entries change.

PyYAML's parser gives the position of each value in the text. A round trip through a tree of values would lay
out the whole file again: it moves comments within flow collections and wraps long lines again. The result is
read again and compared with the edited values, so that a file whose form defeats this (anchors, block
scalars) is refused, not damaged.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, cast

import yaml
from pydantic import BaseModel, ConfigDict, Field

from pointit.maps.model import ENTRIES
from pointit.runtime.config.yaml_file import (
    Loader,
    WrittenFloat,
    WrittenInt,
    compose_yaml,
    parse_yaml,
    written_text,
)
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import part_of_file, rename_to_new
from pointit.schemas.text import system_reason

_Dumper: Any = type("Dumper", (getattr(yaml, "CSafeDumper", yaml.SafeDumper),), {})
"""Puts text in quotes that is another value in YAML 1.1, which PyYAML reads, or in 1.2, which we read."""

Section = Annotated[str, Field(pattern=f"^({'|'.join(name for name in ENTRIES if name != 'links')})$")]
"""A section of named entries."""

EntryName = Annotated[str, Field(min_length=1, max_length=64)]
Key = Annotated[str, Field(min_length=1, max_length=64)]
Data = dict[str, Any]
Pairs = Sequence[tuple[Any, Any]]
"""Nodes of keys and values of a mapping."""
Names = dict[str, dict[str, str]]
"""New names of entries by section and old name."""

_PLAIN = re.compile(r"\w(?:[\w. /-]*\w)?", re.ASCII)
DIGITS = 6
"""Decimal places of numbers that are written."""
LINE_END = re.compile(r"\r\n|[\n\r\x85\u2028\u2029]")


class StaleMapError(RefusedError):
    """The map file has changed since the caller read it: read it again."""


def write_new(path: Path, text: str | bytes) -> None:
    """Write `text` to a new file, which is there once it is complete.

    Raises:
        ConfigError: If it exists already, or cannot be written.
    """
    part = part_of_file(path)
    content = text.encode() if isinstance(text, str) else text
    try:
        try:
            with part.open("xb") as opened:
                opened.write(content)
            rename_to_new(part, path)
        finally:
            part.unlink(missing_ok=True)
    except FileExistsError as error:
        raise ConfigError(f"{path}: exists already; choose another name or move it away") from error
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({system_reason(error)})") from error


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


class _Edit(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    section: Section
    name: Annotated[EntryName, Field(description="in the file as it is, also beside a `rename`")]


class SetValue(_Edit):
    """Set the value of a key, or remove the key if it is None."""

    op: Literal["set"] = "set"
    key: Key
    value: Any


class Add(_Edit):
    """Add an entry at the end of its section."""

    op: Literal["add"] = "add"
    value: dict[Key, Any]


class Remove(_Edit):
    """Remove an entry. What refers to it stays."""

    op: Literal["remove"] = "remove"


class Rename(_Edit):
    """Rename an entry, in what refers to it, too."""

    op: Literal["rename"] = "rename"
    to: EntryName


Edit = Annotated[SetValue | Add | Remove | Rename, Field(discriminator="op")]
"""All edits of one batch name entries as they are in the file, so that two can swap their names."""


class _Splice(NamedTuple):
    start: int
    end: int
    text: str


def edited(content: bytes, edits: Sequence[Edit], path: Path) -> bytes:
    """Return the text of the map at `path` after `edits`, which name entries as they are in `content`.

    Raises:
        ConfigError: If `content` is not YAML.
        RefusedError: If an entry is not there, a name would be there twice, a number is not finite, or
            the file's form does not allow a change in place.
    """
    wanted = _data(content, path)
    names = _apply(wanted, edits)
    document = _Document(content.decode("utf-8"))
    result = document.holding(wanted, names)
    try:
        is_as_wanted = _whole(_data(result.encode(), path)) == _whole(wanted)
    except Exception:  # noqa: BLE001 - whatever it is, the text is not what was meant
        is_as_wanted = False
    if not is_as_wanted:
        raise RefusedError(
            f"{path}: the file's form does not allow this change here (anchors, values over several lines); "
            "change it with a text editor"
        )
    return result.encode()


def _data(content: bytes, path: Path) -> Data:
    data = cast("Data", _plain(parse_yaml(content, path)))
    if "lamps" not in data and "leds" in data:
        data["lamps"] = data.pop("leds")
    return data


def _whole(data: Data) -> Data:
    """Return `data` without empty sections."""
    return {section: value for section, value in data.items() if value}


def _plain(value: Any) -> Any:
    """Return a copy that shares nothing."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in cast("Data", value).items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in cast("Sequence[Any]", value)]
    return value


def _rounded(value: Any) -> Any:
    """Return a copy of `value` with numbers as they are written.

    Raises:
        RefusedError: If a number is not finite.
    """
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in cast("Data", value).items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in cast("Sequence[Any]", value)]
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        raise RefusedError(f"{value} is no number; write metres or degrees")
    return round(value, DIGITS)


def _apply(data: Data, edits: Sequence[Edit]) -> Names:
    """Apply `edits` to `data`. Return the renamed entries.

    Raises:
        RefusedError: If an entry is not there, or two have one name.
    """
    # Values, in entries that have their old names. Removals and renames are only noted, so that two edits of
    # one entry find it.
    names: Names = {}
    removed: set[tuple[str, str]] = set()
    for edit in edits:
        if isinstance(edit, Add):
            continue
        entries: Data = data.get(edit.section) or {}
        entry = entries.get(edit.name)
        if not isinstance(entry, dict):
            raise StaleMapError(f"{edit.section}.{edit.name} is not in the file; load the map again")
        if isinstance(edit, SetValue):
            _set(cast("Data", entry), edit.key, edit.value)
        elif isinstance(edit, Remove):
            removed.add((edit.section, edit.name))
        else:
            names.setdefault(edit.section, {})[edit.name] = edit.to

    # Removed entries free their names for others, and renamed ones for new entries
    for section, name in removed:
        del data[section][name]
        names.get(section, {}).pop(name, None)
    is_set = {(edit.name, edit.key) for edit in edits if isinstance(edit, SetValue)}
    for section, renamed in names.items():
        _rename(data, section, renamed, is_set)
    for edit in edits:
        if isinstance(edit, Add):
            _add(data, edit.section, edit.name, _rounded(edit.value))
    return names


def _set(entry: Data, key: str, value: Any) -> None:
    if value is None:
        entry.pop(key, None)
    else:
        entry[key] = _rounded(value)


def _rename(data: Data, section: str, names: Mapping[str, str], is_set: set[tuple[str, str]]) -> None:
    """Give entries of `section` new names, in what refers to them, too, but things in `is_set`."""
    references = [*_references(data, section, is_set)]
    for holder, key in references:
        old_name = str(written_text(holder[key]))
        holder[key] = names.get(old_name, holder[key])
    entries = cast("Data", data[section])
    data[section] = {}
    for name, entry in entries.items():
        _add(data, section, names.get(name, name), entry)


def _add(data: Data, section: str, name: str, entry: Any) -> None:
    entries: Data = data.get(section) or {}
    if name in entries:
        raise RefusedError(f"{section}.{name} would be there twice; choose another name")
    data[section] = {**entries, name: entry}


def _references(data: Data, section: str, is_set: set[tuple[str, str]]) -> Iterator[tuple[Data, str]]:
    """Yield holders and keys of values that name an entry of `section`, but those of things in `is_set`."""
    # Links and bays name belts, or strips in a map without belts
    is_lane = section == "belts"
    if section == "strips":
        is_lane = not data.get("belts")
    if is_lane:
        yield from _lane_references(data)

    # Things name a part of a strip or of a belt, or a lamp
    things: Mapping[str, Data] = data.get("things") or {}
    for name, thing in things.items():
        for key, kind in (("light", "strip"), ("at", "belt")):
            place = thing.get(key)
            if place is None or (name, key) in is_set:
                continue
            if isinstance(place, dict):
                if section == f"{kind}s" and kind in place:
                    yield cast("Data", place), kind
            elif (section, key) == ("lamps", "light"):
                yield thing, key


def _lane_references(data: Data) -> Iterator[tuple[Data, str]]:
    """Yield holders and keys of values that name a belt, or a strip along which objects move."""
    links: Sequence[Data] = data.get("links") or ()
    for link in links:
        for key in ("from", "to"):
            if key in link:
                yield link, key
    bays: Data = data.get("bays") or {}
    for bay in bays:
        yield bays, bay


def _flow(value: Any) -> str:
    """Return `value` as YAML on one line."""
    if isinstance(value, dict):
        pairs = [_pair(key, item) for key, item in cast("Data", value).items()]
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, list):
        items = [_flow(item) for item in cast("Sequence[Any]", value)]
        return "[" + ", ".join(items) + "]"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, float):
        return f"{value:.{DIGITS}f}".rstrip("0").rstrip(".")
    return json.dumps(value)


def _pair(name: str, value: Any) -> str:
    """Return key and value of a mapping as YAML on one line."""
    return f"{_key(name)}: {_flow(value)}"


def _key(name: str) -> str:
    """Return a name as YAML. A number needs no quotes if every reader has the same text for it."""
    is_number = re.fullmatch("0|[1-9][0-9]*", name) is not None
    return name if is_number else quoted(name)


class _Document:
    """The text of a map, and where its values are."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._newline = "\r\n" if "\r\n" in text else "\n"
        self._lines = [0, *(match.end() for match in LINE_END.finditer(text))]
        root = compose_yaml(text)
        self._pairs: list[tuple[Any, Any]] = [] if root is None else root.value

    def holding(self, data: Data, names: Names) -> str:
        """Return the text with the least changes that make it hold `data`; another one if they overlap."""
        parts: list[str] = []
        copied = 0
        splices = sorted(self._sections(data, names), key=lambda splice: splice[:2])
        for start, end, text in splices:
            parts += (self._text[copied:start], text)
            copied = end
        return "".join((*parts, self._text[copied:]))

    def _sections(self, data: Data, names: Names) -> Iterator[_Splice]:
        """Yield changes of the sections, and the sections that the text does not have."""
        missing = dict(_whole(data))
        for key, node in self._pairs:
            section = key.value
            if section == "leds" and "leds" not in data:  # the old name of lamps
                section = "lamps"
            value = missing.pop(section, {})
            if isinstance(node, yaml.ScalarNode) and isinstance(value, dict):
                if value:  # nothing yet
                    start = self._text.index(":", self._at(key.end_mark)) + 1
                    yield _Splice(start, self._end(node), self._block(cast("Data", value)))
            else:
                yield from self._node(key, node, value, names.get(section, {}))
        if missing:
            end = len(self._text)
            ends_line = not end or self._text[-1] in "\r\n"
            text = "" if ends_line else self._newline
            for section, entries in missing.items():
                text += f"{section}:{self._block(entries)}{self._newline}"
            yield _Splice(end, end, text)

    def _block(self, entries: Data) -> str:
        """Return the entries of a section, each on a line that begins with its end."""
        lines = [f"{self._newline}  {_pair(name, value)}" for name, value in entries.items()]
        return "".join(lines)

    def _node(self, key: Any, node: Any, value: Any, names: Mapping[str, str]) -> Iterator[_Splice]:
        """Yield changes that make `node`, of `key` if it is in a mapping, hold `value`; `names`: new keys."""
        if isinstance(node, yaml.MappingNode) and isinstance(value, dict):
            yield from self._mapping(node, cast("Data", value), names)
        elif isinstance(node, yaml.SequenceNode) and _is_as_long(value, node):
            for item_node, item in zip(node.value, value, strict=True):
                yield from self._node(None, item_node, item, {})
        elif isinstance(node, yaml.ScalarNode) and not isinstance(value, (list, dict)):
            if _value(node) != value:
                yield _Splice(self._at(node.start_mark), self._end(node), _flow(value))
        elif key is None:
            yield _Splice(self._at(node.start_mark), self._end(node), _flow(value))
        else:  # on the line of its key: it may begin elsewhere as a block only
            start = self._text.index(":", self._at(key.end_mark)) + 1
            yield _Splice(start, self._end(node), " " + _flow(value))

    def _mapping(self, node: Any, value: Data, names: Mapping[str, str]) -> Iterator[_Splice]:
        """Yield changes of a mapping: keys and values that stay, then those removed and added."""
        pairs = [(key, value_node) for key, value_node in node.value if not key.tag.endswith(":merge")]
        new_names: list[str] = []
        for key, value_node in pairs:
            old_name = str(key.value)
            name = names.get(old_name, old_name)
            new_names.append(name)
            if name not in value:
                continue
            if name != old_name:
                yield _Splice(self._at(key.start_mark), self._at(key.end_mark), _key(name))
            yield from self._node(key, value_node, value[name], {})
        removed = [name not in value for name in new_names]
        added = [_pair(name, item) for name, item in value.items() if name not in new_names]
        if node.flow_style:
            yield from self._in_flow(self._at(node.start_mark) + 1, pairs, removed, added)
        else:
            yield from self._in_block(pairs, removed, added)

    def _in_flow(
        self, end: int, pairs: Pairs, removed: Sequence[bool], added: Sequence[str]
    ) -> Iterator[_Splice]:
        """Yield changes between braces. A pair goes with the comma before it, the first with that behind."""
        for index, (key, value) in enumerate(pairs):
            previous_end = end
            end = self._end(value)
            if not removed[index]:
                continue
            if not all(removed[:index]):
                yield _Splice(previous_end, end, "")
                continue
            next_start = end
            if index + 1 < len(pairs):
                next_key, _ = pairs[index + 1]
                next_start = self._at(next_key.start_mark)
            yield _Splice(self._at(key.start_mark), next_start, "")
        if added:
            comma = "" if all(removed) else ", "
            yield _Splice(end, end, comma + ", ".join(added))

    def _in_block(self, pairs: Pairs, removed: Sequence[bool], added: Sequence[str]) -> Iterator[_Splice]:
        """Yield changes of whole lines, those added with the indent of the first one."""
        for (key, value), is_removed in zip(pairs, removed, strict=True):
            if is_removed:
                yield _Splice(self._lines[key.start_mark.line], self._next_line(value), "")
        if added:
            first_key, _ = pairs[0]
            _, last_value = pairs[-1]
            end = self._next_line(last_value)
            text = "" if self._text[end - 1] in "\n\r" else self._newline
            indent = " " * first_key.start_mark.column
            for pair in added:
                text += f"{indent}{pair}{self._newline}"
            yield _Splice(end, end, text)

    def _at(self, mark: Any) -> int:
        """Return the place of `mark` in the text; the parser's own index counts otherwise."""
        line = int(mark.line)
        column = int(mark.column)
        return self._lines[line] + column

    def _end(self, node: Any) -> int:
        """Return where the text of `node` ends; the parser ends a block where the next thing begins."""
        if isinstance(node, yaml.ScalarNode) or node.flow_style or not node.value:
            return self._at(node.end_mark)
        if isinstance(node, yaml.MappingNode):
            _, last_value = node.value[-1]
            return self._end(last_value)
        return self._end(node.value[-1])

    def _next_line(self, node: Any) -> int:
        """Return the beginning of the line after `node`, and a comment beside it."""
        end = self._end(node)
        for start in self._lines:
            if start > end:
                return start
        return len(self._text)


def _is_as_long(value: Any, node: Any) -> bool:
    return isinstance(value, list) and len(cast("Sequence[Any]", value)) == len(node.value)


def _value(node: Any) -> object:
    """Return the value of a scalar, None of others."""
    if not isinstance(node, yaml.ScalarNode):
        return None
    loader: Any = Loader("")
    try:
        value: object = loader.construct_object(node)
        return value
    finally:
        loader.dispose()
