"""Edits of the text of YAML that people write: only the characters of changed values and keys change.

PyYAML's parser gives the position of each value in the text. A round trip through a tree of values would lay
out the whole file again: it moves comments within flow collections and wraps long lines again. The result is
read again and compared with the wanted values, so that a file whose form defeats this (anchors, block
scalars) is refused, not damaged.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import yaml

from pointit.runtime.config.yaml_file import Loader, WrittenFloat, WrittenInt, compose_yaml, parse_yaml
from pointit.runtime.errors import RefusedError

_Dumper: Any = type("Dumper", (getattr(yaml, "CSafeDumper", yaml.SafeDumper),), {})
"""Puts text in quotes that is another value in YAML 1.1, which PyYAML reads, or in 1.2, which we read."""

Data = dict[str, Any]
"""Sections, or entries of one, by name."""
Pairs = Sequence[tuple[Any, Any]]
"""Nodes of keys and values of a mapping."""
Names = Mapping[str, Mapping[str, str]]
"""New names of entries by section and old name."""

_PLAIN = re.compile(r"\w(?:[\w. /-]*\w)?", re.ASCII)
DIGITS = 6
"""Decimal places of numbers that are written."""
LINE_END = re.compile(r"\r\n|[\n\r\x85\u2028\u2029]")
DOCUMENT_END = re.compile(r"^\.\.\.(?=\s|$)", re.MULTILINE)
"""Mark behind which nothing belongs to the document."""


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


class _Splice(NamedTuple):
    start: int
    end: int
    text: str


def with_values(
    content: bytes,
    data: Data,
    path: Path,
    names: Names | None = None,
    *,
    old_names: Mapping[str, str] | None = None,
) -> bytes:
    """Return the YAML text `content` of `path` with the least changes that make it hold `data`.

    A section that `data` has not is removed with its lines; one that is empty there loses its entries.

    `names` are new names of entries by section and old name, whose keys are changed in place. `old_names` are
    those of sections by the names that older files give them.

    Raises:
        ConfigError: If `content` is not YAML.
        RefusedError: If the file's form does not allow a change in place.
    """
    old_names = old_names or {}
    wanted = _whole(data)
    document = _Document(content.decode("utf-8"), old_names)
    result = document.holding(data, names or {}).encode()
    try:
        written = parse_yaml(result, path)
        for old_name, name in old_names.items():
            if old_name in written and name not in written:
                written[name] = written.pop(old_name)
        is_as_wanted = _whole(written) == wanted
    except Exception:  # noqa: BLE001 - whatever it is, the text is not what was meant
        is_as_wanted = False
    if not is_as_wanted:
        raise RefusedError(
            f"{path}: the file's form does not allow this change here (anchors, values over several lines); "
            "change it with a text editor"
        )
    return result


def _whole(data: Data) -> Data:
    """Return `data` without empty sections."""
    return {section: value for section, value in data.items() if value or value in (0, False)}


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
    """The text of a file, and where its values are."""

    def __init__(self, text: str, old_names: Mapping[str, str]) -> None:
        self._text = text
        self._old_names = old_names
        self._newline = "\r\n" if "\r\n" in text else "\n"
        self._lines = [0, *(match.end() for match in LINE_END.finditer(text))]
        root = compose_yaml(text)
        self._pairs: list[tuple[Any, Any]] = []
        self._flow_root: Any = None
        if isinstance(root, yaml.MappingNode):
            self._pairs = root.value
            self._flow_root = root if root.flow_style else None

    def holding(self, data: Data, names: Names) -> str:
        """Return the text with the least changes that make it hold `data`; another one if they overlap."""
        parts: list[str] = []
        copied = 0
        if self._flow_root is None:
            changes = self._sections(data, names)
        else:
            changes = self._mapping(self._flow_root, data, {})
        splices = sorted(changes, key=lambda splice: splice[:2])
        for start, end, text in splices:
            parts += (self._text[copied:start], text)
            copied = end
        return "".join((*parts, self._text[copied:]))

    def _sections(self, data: Data, names: Names) -> Iterator[_Splice]:
        """Yield changes of the sections, and the sections that the text does not have."""
        missing = dict(_whole(data))
        for key, node in self._pairs:
            section = key.value
            if section not in data:
                section = self._old_names.get(section, section)
            if section not in data:
                yield _Splice(self._lines[key.start_mark.line], self._next_line(node), "")
                continue
            missing.pop(section, None)
            value = data[section]
            if isinstance(node, yaml.ScalarNode) and isinstance(value, dict):
                if value:  # nothing yet
                    start = self._text.index(":", self._at(key.end_mark)) + 1
                    yield _Splice(start, self._end(node), self._block(cast("Data", value)))
            else:
                yield from self._node(key, node, value, names.get(section, {}))
        if missing:
            end = self._document_end()
            ends_line = not end or self._text[end - 1] in "\r\n"
            text = "" if ends_line else self._newline
            for section, value in missing.items():
                text += f"{self._section(section, value)}{self._newline}"
            yield _Splice(end, end, text)

    def _document_end(self) -> int:
        """Return where a new section belongs: at the end of the text, or of its first document."""
        last_end = 0
        if self._pairs:
            _, last_value = self._pairs[-1]
            last_end = self._end(last_value)
        mark = DOCUMENT_END.search(self._text, last_end)
        return len(self._text) if mark is None else mark.start()

    def _section(self, name: str, value: Any) -> str:
        """Return a new section as YAML."""
        if isinstance(value, dict):
            return f"{_key(name)}:{self._block(cast('Data', value))}"
        return _pair(name, value)

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
