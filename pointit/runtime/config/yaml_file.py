"""YAML files of unknown origin, which must neither end nor block a process, with the values of YAML 1.2.

Keys are literal text: most are names. Values are those of YAML 1.2; a warning says where YAML 1.1 differs.
"""

import functools
import logging
import re
from pathlib import Path
from typing import Any, TypeVar, cast

import yaml

from pointit.runtime.errors import ConfigError
from pointit.schemas.text import first_of, system_reason

log = logging.getLogger(__name__)

T = TypeVar("T", int, float)
Loader: Any = type(
    "Loader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {"yaml_implicit_resolvers": {}}
)
"""The one in C where PyYAML has it, a large map in a second instead of ten; with values as here."""

MAX_YAML_INT = 1000
"""Characters of a whole number: Python does not show those with some thousands of digits."""
_TAG = "tag:yaml.org,2002:"
MERGE = f"{_TAG}merge"
TEXT = f"{_TAG}str"
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
_TRUE = ("yes", "on", "y", "true")
_FALSE = ("no", "off", "n", "false")
FLAGS = dict.fromkeys(_TRUE, "true") | dict.fromkeys(_FALSE, "false")
"""Words of YAML 1.1 in lower case. All but `true` and `false` are text, which a bool field understands."""
_DISPUTED_NUMBER = re.compile(r"[-+]?(0b|0o|0+([1-9][0-9]|[89])[0-9]*\Z)|.*_")
_BASES = {"0b": 2, "0o": 8, "0x": 16}
MAX_YAML_DEPTH = 100
MAX_YAML_UNFOLDED = 200_000
"""Maximum number of values that come from aliases. Checking that many takes a second."""
MAX_YAML_BYTES = 4 * 1024 * 1024
"""Size limit of a file. The C loader takes some seconds for it."""
MAX_WARNINGS = 1000


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
    base = _BASES.get(digits.lstrip("+-")[:2], 10)
    value = int(digits, base)
    return _written(loader, node, value, WrittenInt)


def _float(loader: Any, node: yaml.ScalarNode) -> float:
    digits = node.value.replace("_", "").lower()
    value = float(digits.replace(".inf", "inf").replace(".nan", "nan"))
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
        whole = re.compile(rf"(?:{pattern})\Z")
        Loader.add_implicit_resolver(_TAG + name, whole, first)
    for letter, rows in yaml.SafeLoader.yaml_implicit_resolvers.items():
        for tag, pattern in rows:
            if tag.removeprefix(_TAG) in ("bool", "int", "float", "timestamp"):
                Loader.add_implicit_resolver(_DISPUTED, pattern, [letter])


_add_resolvers()
Loader.add_constructor(f"{_TAG}int", _int)
Loader.add_constructor(f"{_TAG}float", _float)
Loader.add_constructor(_DISPUTED, _disputed_text)
Loader.add_constructor(MERGE, Loader.construct_scalar)


def check_nesting_depth(text: str) -> None:
    """Check that the C loader does not run out of stack on `text`, which would end the process.

    Raises:
        RecursionError: If it is nested too deeply.
        yaml.YAMLError: If it is not YAML.
    """
    loader = Loader(text)
    depth = 0
    try:
        while loader.check_event():
            event = loader.get_event()
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_YAML_DEPTH:
                raise RecursionError
    finally:
        loader.dispose()


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises:
        ConfigError: If it cannot be read, or `parse_yaml` rejects it.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_YAML_BYTES + 1)
    except OSError as error:
        reason = system_reason(error)
        raise ConfigError(f"{path}: cannot be read ({reason}); check its path and rights") from error
    return parse_yaml(content, path)


def parse_yaml(content: bytes, path: Path | str) -> dict[str, Any]:
    """Return the mapping in `content`, which is of `path`, or of whatever sentences are to name.

    Raises:
        ConfigError: it is too large, is not YAML, has a key twice, or is not a mapping; it is nested too
            deeply, or its aliases unfold to too much.
    """
    if len(content) > MAX_YAML_BYTES:
        raise ConfigError(f"{path}: is too large, at most {MAX_YAML_BYTES // 1024**2} MiB are read")
    try:
        data = load_yaml(content.decode("utf-8"), path)
    except UnicodeDecodeError as error:
        line = len(content[: error.start + 1].splitlines())
        raise ConfigError(f"{path}: line {line} is not UTF-8; save the file as UTF-8") from error
    if not isinstance(data, (dict, type(None))):
        raise ConfigError(f"{path}: a mapping of names to values was expected, got {type(data).__name__}")
    return cast("dict[str, Any]", data or {})


def load_yaml(text: str, source: Path | str) -> Any:
    """Return the value in `text`, with keys as they are written, and numbers as `written_text` needs them.

    Raises:
        ConfigError: As `parse_yaml`, with `source`.
    """
    loader = Loader("")
    try:
        root = compose_yaml(text)
        data = None if root is None else loader.construct_document(root)
    except RecursionError as error:
        raise ConfigError(f"{source}: is nested too deeply") from error
    except YamlContentError as error:
        problem, node = error.args
        line = node.start_mark.line + 1
        raise ConfigError(f"{source}: line {line}: {problem}") from error
    except (yaml.YAMLError, ValueError, LookupError, AttributeError) as error:  # of tags: !!bool x
        mark = getattr(error, "problem_mark", None)
        position = ""
        if mark:
            position = f" in line {mark.line + 1}"
        elif not isinstance(error, yaml.YAMLError):
            position = " at a tag"
        problem = getattr(error, "problem", None) or error
        text = " ".join(str(problem).split())
        raise ConfigError(f"{source}: is not YAML{position} ({text})") from error
    finally:
        loader.dispose()

    # Values that a reader of YAML 1.1 would take for others: one warning for all, with the first remedy
    disputed = sorted(disputes_of(loader))
    if disputed and not isinstance(root, yaml.ScalarNode):  # of --set
        line, warning = disputed[0]
        other_lines = {disputed_line for disputed_line, _ in disputed} - {line}
        others = [str(other_line) for other_line in sorted(other_lines)]
        more = f"; line {first_of(others, 10)}, too" if others else ""
        _warn_once(f"{source}: line {line}: {warning}{more}")
    return data


def compose_yaml(text: str) -> Any:
    """Return the root node of `text`, of which all keys but merges are text, or None if it is empty.

    Raises:
        RecursionError: If it is nested too deeply.
        yaml.YAMLError: If it is not YAML, has a key twice, or its aliases unfold to too much.
    """
    check_nesting_depth(text)
    loader = Loader(text)
    try:
        root = loader.get_single_node()
    finally:
        loader.dispose()
    if root is not None and not isinstance(root, yaml.ScalarNode):
        _check_aliases(root)
        _name_keys(root)
    return root


def _check_aliases(root: yaml.Node) -> None:
    """Check that the document can be validated in time: aliases of aliases, and a hundred levels, cannot.

    Raises:
        RecursionError: If it is nested too deeply.
        YamlContentError: If its aliases unfold to too much.
    """
    sizes: dict[int, int] = {}  # with everything below
    depths: dict[int, int] = {}  # not there while it is counted: an anchor that holds itself has no end
    written = 0
    waiting: list[tuple[Any, list[Any] | None]] = [(root, None)]
    while waiting:
        node, inner = waiting.pop()

        # Second visit: all below is counted
        if inner is not None:
            sizes[id(node)] += sum([sizes[id(part)] for part in inner])
            inner_depths = [depths.get(id(part), MAX_YAML_DEPTH) for part in inner]
            depths[id(node)] = 1 + max(inner_depths, default=0)
            if depths[id(node)] > MAX_YAML_DEPTH:
                raise RecursionError
            if sizes[id(node)] > written + MAX_YAML_UNFOLDED:
                raise YamlContentError(
                    f"aliases unfold to more than {MAX_YAML_UNFOLDED} values; write them out", node
                )

        # First visit: scalars are counted at once, and all others before the second visit
        elif id(node) not in sizes:
            below: list[Any] = node.value
            if isinstance(node, yaml.MappingNode):
                below = [part for pair in node.value for part in pair]
            inner = [part for part in below if not isinstance(part, yaml.ScalarNode)]
            scalar_count = len(below) - len(inner)
            sizes[id(node)] = 1 + scalar_count
            written += sizes[id(node)]
            waiting.append((node, inner))
            waiting += [(part, None) for part in inner]


def _name_keys(root: yaml.Node) -> None:
    """Make all keys text. Check that no mapping has one twice: PyYAML drops the first silently."""
    waiting: list[Any] = [root]
    visited: set[int] = set()
    while waiting:
        node = waiting.pop()
        if id(node) in visited or isinstance(node, yaml.ScalarNode):
            continue
        visited.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            waiting += node.value
            continue
        lines: dict[str, int] = {}
        for index, (key, value) in enumerate(node.value):
            waiting += (key, value)
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.tag == MERGE and _is_alias(value, key):
                continue
            if key.value in lines:
                problem = f"the key {key.value!r} occurs twice, first in line {lines[key.value]}; keep one"
                raise YamlContentError(problem, key)
            lines[key.value] = key.start_mark.line + 1
            if key.tag != TEXT:  # its own node may be an anchor, with another value elsewhere
                text = yaml.ScalarNode(TEXT, key.value, key.start_mark, key.end_mark, key.style)
                node.value[index] = text, value


def _is_alias(node: Any, key: yaml.Node) -> bool:
    """Return True if `node`, or all nodes of a list, are before `key`. Else `<<` is a name like others."""
    nodes: list[yaml.Node] = node.value if isinstance(node, yaml.SequenceNode) else [node]
    return all(part.start_mark.index < key.start_mark.index for part in nodes)


@functools.lru_cache(MAX_WARNINGS)
def _warn_once(sentence: str) -> None:
    log.warning("%s", sentence)
