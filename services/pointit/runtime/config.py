"""Configuration: one pydantic tree per service, filled from YAML, environment and command line.

Later sources win: defaults, files in order, `POINTIT_<SERVICE>__<FIELD>` variables, options.
"""

import datetime as dt
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from pointit.runtime.complaint import complaint
from pointit.runtime.errors import ConfigError
from pointit.runtime.yaml_loader import MAX_YAML_DEPTH, Loader, refuse_depth

C = TypeVar("C", bound="Config")

MERGE = "tag:yaml.org,2002:merge"
MAX_YAML_UNFOLDED = 200_000
"""Values that stand in a file only as aliases; to check so many takes a second."""
MAX_YAML_BYTES = 4 * 1024 * 1024
"""Of a file that is read; the C loader takes some seconds for it."""


class Config(BaseModel):
    """Base of every configuration: frozen, and a field that does not exist is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    REPLACED: typing.ClassVar[tuple[str, ...]] = ()
    """Fields whose mapping in a later source replaces the earlier one. All others are merged by name."""


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises:
        ConfigError: it cannot be read, or is not what `parse_yaml` takes.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_YAML_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
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
    refuse_depth(text)
    loader = Loader(text)
    try:
        root = loader.get_single_node()
        if root is None:
            return None
        if not isinstance(root, yaml.ScalarNode):
            _refuse_bombs(root)
        _refuse_twins(root)
        return loader.construct_document(root)
    finally:
        loader.dispose()


def _refuse_bombs(root: yaml.Node) -> None:
    """Refuse what nobody can check in time: aliases of aliases of aliases, and a hundred things nested.

    Raises:
        RecursionError: it is nested too deeply.
        yaml.MarkedYAMLError: its aliases unfold to too much.
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


def _refuse_twins(root: yaml.Node) -> None:
    """Refuse what YAML forbids and PyYAML drops silently: a key that stands twice in one mapping."""
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


class Layers:
    """Values from several sources, the later ones on top, each remembered with where it came from."""

    def __init__(self, replaced: Sequence[str] = ()) -> None:
        """Begin without values; `replaced` are the fields of `Config.REPLACED`."""
        self.values: dict[str, Any] = {}
        self._replaced = replaced
        self._sources: dict[tuple[str, ...], str] = {}

    def add(self, values: Mapping[str, Any], source: str) -> None:
        """Lay `values` on top; mappings are merged but for `replaced` ones, everything else is replaced."""
        for name in self._replaced:
            if isinstance(values.get(name), Mapping):
                self.values.pop(name, None)
        self._lay(values, source)

    def add_text(self, path: Sequence[str], text: str, source: str) -> None:
        """Lay one value on top, given as YAML text (`0.5`, `[1, 2]`, `red`).

        A single word or number stays text, for the field to read: `no` may be a name, `7` an id.
        """
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ConfigError(f"{source}: is not a value ({text!r})") from error
        is_word = isinstance(value, str | bool | int | float | dt.date)
        nested: Any = text.strip() if is_word and not text.lstrip().startswith(("'", '"')) else value
        for name in reversed(path[1:]):
            nested = {name: nested}
        if len(path) > 1:  # one entry of a mapping, which is changed and not replaced
            self._lay({path[0]: nested}, source)
        else:
            self.add({path[0]: nested}, source)

    def add_environment(self, environment: Mapping[str, str], prefix: str) -> None:
        """Lay variables `<prefix>A__B` on top as `a.b`."""
        for variable, text in sorted(environment.items()):
            if variable.startswith(prefix):
                path = variable[len(prefix) :].lower().split("__")
                self.add_text(path, text, f"variable {variable}")

    def build(self, kind: type[C]) -> C:
        """Return the configuration.

        Raises:
            ConfigError: names the source, the field, the value and what is wrong with it.
        """
        try:
            return kind.model_validate(self.values)
        except ValidationError as error:
            loc = tuple(str(part) for part in error.errors(include_url=False)[0]["loc"])
            raise ConfigError(f"{self._source_of(loc)}: {complaint(error, kind)}") from error

    def _lay(self, values: Mapping[str, Any], source: str) -> None:
        self._sources.setdefault((), source)  # of a value that is missing
        self._merge(self.values, values, (), source)

    def _merge(
        self, into: dict[str, Any], values: Mapping[str, Any], path: tuple[str, ...], source: str
    ) -> None:
        for raw, value in values.items():
            key = str(raw)
            here = (*path, key)
            self._sources[here] = source
            if isinstance(value, Mapping):
                current = into.get(key)
                below = typing.cast("dict[str, Any]", current) if isinstance(current, dict) else {}
                into[key] = below
                self._merge(below, typing.cast("Mapping[str, Any]", value), here, source)
            else:
                into[key] = value

    def _source_of(self, loc: tuple[str, ...]) -> str:
        for length in range(len(loc), -1, -1):
            source = self._sources.get(loc[:length])
            if source is not None:
                return source
        return "configuration"
