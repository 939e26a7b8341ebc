"""YAML files of unknown origin, which must neither end nor block a process."""

import typing
from pathlib import Path
from typing import Any

import yaml

from pointit.runtime.errors import ConfigError

MAX_YAML_DEPTH = 100
MAX_YAML_INT = 1000
"""Characters of a whole number: Python does not show those with some thousands of digits."""

Loader: Any = type("Loader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
"""The one in C where PyYAML has it, a large map in a second instead of ten; with whole numbers as here."""

MERGE = "tag:yaml.org,2002:merge"
MAX_YAML_UNFOLDED = 200_000
"""Values that stand in a file only as aliases; to check so many takes a second."""
MAX_YAML_BYTES = 4 * 1024 * 1024
"""Size limit of a file. The C loader takes some seconds for it."""


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


def _int(loader: Any, node: yaml.ScalarNode) -> int:
    if len(node.value) > MAX_YAML_INT:
        raise yaml.MarkedYAMLError(
            problem=f"a number has more than {MAX_YAML_INT} digits", problem_mark=node.start_mark
        )
    return typing.cast("int", loader.construct_yaml_int(node))


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises:
        ConfigError: If it cannot be read, or `parse_yaml` rejects it.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_YAML_BYTES + 1)
    except OSError as error:
        why = error.strerror or error
        raise ConfigError(f"{path}: cannot be read ({why}); check its path and rights") from error
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
        data = _load_yaml(content.decode("utf-8"))
    except RecursionError as error:
        raise ConfigError(f"{path}: is nested too deeply") from error
    except (yaml.YAMLError, ValueError) as error:  # ValueError: not UTF-8, or a date such as 2024-99-99
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark is not None else ""
        problem = " ".join(str(getattr(error, "problem", None) or error).split())
        raise ConfigError(f"{path}: is not YAML{where} ({problem})") from error
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: a mapping of names to values was expected, got {type(data).__name__}")
    return {str(key): value for key, value in typing.cast("dict[object, Any]", data).items()}


def _load_yaml(text: str) -> Any:
    check_nesting_depth(text)
    loader = Loader(text)
    try:
        root = loader.get_single_node()
        if root is None:
            return None
        if not isinstance(root, yaml.ScalarNode):
            _check_aliases(root)
        _check_unique_keys(root)
        return loader.construct_document(root)
    finally:
        loader.dispose()


def _check_aliases(root: yaml.Node) -> None:
    """Check that the document can be validated in time: aliases of aliases, and a hundred levels, cannot.

    Raises:
        RecursionError: If it is nested too deeply.
        yaml.MarkedYAMLError: If its aliases unfold to too much.
    """
    sizes: dict[int, int] = {}  # with everything below; 1 while it is counted: an anchor may hold itself
    depths: dict[int, int] = {}
    written = 0
    waiting: list[tuple[Any, list[Any] | None]] = [(root, None)]
    while waiting:
        node, inner = waiting.pop()
        if inner is not None:
            sizes[id(node)] += sum([sizes[id(each)] for each in inner])
            depths[id(node)] += max([depths[id(each)] for each in inner], default=0)
            if depths[id(node)] > MAX_YAML_DEPTH:
                raise RecursionError
            if sizes[id(node)] > written + MAX_YAML_UNFOLDED:
                raise yaml.MarkedYAMLError(
                    problem=f"its aliases unfold to more than {MAX_YAML_UNFOLDED} values, write them out",
                    problem_mark=node.start_mark,
                )
        elif id(node) not in sizes:
            is_mapping = isinstance(node, yaml.MappingNode)
            below: list[Any] = [each for pair in node.value for each in pair] if is_mapping else node.value
            inner = [each for each in below if not isinstance(each, yaml.ScalarNode)]
            sizes[id(node)], depths[id(node)] = 1 + len(below) - len(inner), 1
            written += sizes[id(node)]
            waiting.append((node, inner))
            waiting += [(each, None) for each in inner]


def _check_unique_keys(root: yaml.Node) -> None:
    """Check that no mapping has a key twice. YAML forbids it, PyYAML drops the first silently."""
    waiting: list[Any] = [root]
    visited: set[int] = set()  # an anchor may hold itself
    while waiting:
        node = waiting.pop()
        if id(node) in visited:
            continue
        visited.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            waiting += node.value
        elif isinstance(node, yaml.MappingNode):
            names: set[tuple[str, str]] = set()
            for key, value in node.value:
                waiting += (key, value)
                if not isinstance(key, yaml.ScalarNode) or key.tag == MERGE:
                    continue
                name = (key.tag, key.value)
                if name in names:
                    raise yaml.MarkedYAMLError(
                        problem=f"{key.value!r} stands there twice, keep one", problem_mark=key.start_mark
                    )
                names.add(name)


Loader.add_constructor("tag:yaml.org,2002:int", _int)
