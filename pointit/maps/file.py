"""Reads maps: the YAML format of the ROS toolkit, with additions."""

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from pointit.maps.environment import broken_references, environment
from pointit.maps.model import ENTRIES, MapFile
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.runtime.config.validation_message import (
    field_names,
    format_value,
    join_names,
    more_errors_suffix,
)
from pointit.runtime.config.yaml_file import MAX_YAML_BYTES, parse_yaml, read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import import_room
from pointit.runtime.host.state_file import read_limited
from pointit.schemas import Environment, KeyNameError, encode
from pointit.schemas.topics import check_name

Clouds = dict[str, NDArray[np.float64]]
"""Points in {W}, n x 3, by the cloud's id."""

PACKAGE = "pointit.maps"
FOLDER = "shipped"
SUFFIX = ".yaml"
MAX_KEYS = 80_000


class MapError(ConfigError):
    """An invalid map. The message names the file and the first mistake, and counts the others."""

    def __init__(self, path: Path, mistakes: Sequence[tuple[str, str]]) -> None:
        where, text = mistakes[0]
        super().__init__(f"{path}: {where}: {text}{more_errors_suffix(len(mistakes) - 1)}")
        self.mistakes = tuple(mistakes)
        """Place in the file (`strips.1.pixels`), and problem with remedy, at least one."""


def shipped_maps() -> tuple[str, ...]:
    """Return the names of the maps that come with PointIt."""
    names: list[str] = []
    for entry in files(PACKAGE).joinpath(FOLDER).iterdir():
        if entry.name.endswith(SUFFIX):
            names.append(entry.name.removesuffix(SUFFIX))
    return tuple(sorted(names))


@contextmanager
def map_path(name_or_path: str) -> Generator[Path]:
    """Yield the file of the shipped map of that name, or the path itself.

    A name with a folder or a suffix (`./site.yaml`) is a path, relative to the current directory.

    Raises:
        ConfigError: If no map of that name is shipped.
    """
    path = Path(name_or_path)
    has_folder = len(path.parts) != 1 or name_or_path.endswith("/")
    if path.suffix or has_folder:
        yield path
        return
    if name_or_path not in shipped_maps():
        path_of_file = f"the path of a file such as ./{name_or_path}{SUFFIX}"
        suggestion = did_you_mean(name_or_path, shipped_maps())
        if suggestion:
            raise ConfigError(f"map {name_or_path!r} is not shipped; {suggestion[:-1]}, or {path_of_file}?")
        raise ConfigError(
            f"map {name_or_path!r} is not shipped: use one of {', '.join(shipped_maps())}, or {path_of_file}"
        )
    with as_file(files(PACKAGE).joinpath(FOLDER, name_or_path + SUFFIX)) as shipped:
        yield shipped


def load_map(name_or_path: str, stamp_ns: int) -> Environment:
    """Return the shipped map of that name, or the one in the file of that path.

    Raises:
        ConfigError: If it is invalid. One sentence with file, key, value and remedy.
    """
    room, _ = load_map_and_clouds(name_or_path, stamp_ns)
    return room


def load_map_and_clouds(name_or_path: str, stamp_ns: int) -> tuple[Environment, Clouds]:
    """Return the map as `load_map`, and the points of its clouds in {W}, n x 3, by id.

    Raises:
        ConfigError: If it is invalid. One sentence with file, key, value and remedy.
    """
    with map_path(name_or_path) as path:
        _, room, clouds = read_whole_map(path, stamp_ns)
        return room, clouds


def read_whole_map(path: Path, stamp_ns: int) -> tuple[MapFile, Environment, Clouds]:
    """Return the file at `path`, its message, and the points of its clouds in {W}, n x 3, by id.

    Raises:
        ConfigError: If it is invalid. One sentence with file, key, value and remedy.
    """
    file = read_map_file(path)
    broken = list(broken_references(file))
    if broken:
        raise MapError(path, broken)
    clouds = read_clouds(path, file)
    return file, to_message(path, file, clouds, stamp_ns), clouds


def read_map_file(path: Path) -> MapFile:
    """Return the content of the file at `path`. Names in `links`, `bays` and `things` may not exist.

    Raises:
        ConfigError: If it is invalid. One sentence with file, key, value and remedy.
    """
    if path.is_file():  # a pipe can be read once
        _check_keys(read_limited(path, MAX_YAML_BYTES), path)
    return _map_of(read_yaml(path), path)


def parse_map_file(content: bytes, path: Path) -> MapFile:
    """Return the map in `content`, as `read_map_file` would for the file at `path`.

    Raises:
        ConfigError: If it is invalid. One sentence with file, key, value and remedy.
    """
    _check_keys(content, path)
    return _map_of(parse_yaml(content, path), path)


def _check_keys(content: bytes, path: Path) -> None:
    """Check that reading takes seconds at most: a map with more keys is too large for a message."""
    keys = content.count(b":")
    if keys > MAX_KEYS:
        raise ConfigError(
            f"{path}: has {keys} keys, limit {MAX_KEYS}, and a map holds about 20000 lamps; "
            "split it into several sites"
        )


def _map_of(sections: Mapping[str, Any], path: Path) -> MapFile:
    """Return the map with these sections, read from `path`.

    Raises:
        ConfigError: If it is invalid. One sentence with file, key, value and remedy.
    """
    data = {section: value for section, value in sections.items() if value is not None}
    if "lamps" not in data and "leds" in data:  # as the ROS toolkit's maps and PointIt's first ones say
        data["lamps"] = data.pop("leds")
    if data and not data.keys() & MapFile.model_fields.keys():  # its values may be secrets of another program
        raise ConfigError(f"{path}: is not a map; a map has sections such as lamps, strips, belts or boxes")

    # All mistakes in one message: names that no key can hold, then values
    mistakes: list[tuple[str, str]] = []
    for section in MapFile.model_fields:
        mistakes += _wrong_names(section, data.get(section))
    try:
        file = MapFile.model_validate(data)
    except ValidationError as error:
        mistakes += _mistakes(error)
        raise MapError(path, mistakes) from error
    if mistakes:
        raise MapError(path, mistakes)

    # Links, bays and frames are about other entries
    content = MapFile.model_fields.keys() - {"links", "bays", "frames"}
    if not any(getattr(file, section) for section in content):
        raise ConfigError(f"{path}: the map is empty; give at least one of lamps, strips, belts")
    return file


def read_clouds(path: Path, file: MapFile) -> Clouds:
    """Return the points of the clouds of `file`, which is at `path`, in {W}.

    Raises:
        MapError: If a file of a cloud is invalid.
        ConfigError: If this build of PointIt has no clouds.
    """
    clouds: Clouds = {}
    mistakes: list[tuple[str, str]] = []
    if not file.clouds:
        return clouds
    reader = import_room("pointit.maps.cloud_file", "reading point clouds")
    for name, entry in file.clouds.items():
        try:
            clouds[name] = reader.read_cloud(path.parent / entry.file, entry)
        except ConfigError as error:
            mistakes.append((f"clouds.{name}.file", str(error)))
    if mistakes:
        raise MapError(path, mistakes)
    return clouds


def to_message(path: Path, file: MapFile, clouds: Clouds, stamp_ns: int) -> Environment:
    """Return the message of `file`, named after its path.

    Raises:
        ConfigError: If it is too large for a message.
    """
    name = path.stem.encode(errors="backslashreplace").decode()  # bytes that are no UTF-8 are no text
    room = environment(file, clouds, name=name, stamp_ns=stamp_ns)
    size = len(encode(room))
    if size > Environment.max_bytes:
        raise ConfigError(
            f"{path}: the map has {size} bytes as a message, limit {Environment.max_bytes}; "
            "split it into several sites"
        )
    return room


def _wrong_names(section: str, entries: Any) -> Iterator[tuple[str, str]]:
    """Yield names that cannot be in a key."""
    if not isinstance(entries, dict):
        return
    for name in cast("dict[str, object]", entries):
        try:
            check_name(name)
        except KeyNameError as error:
            label = f", and give it the label {format_value(name)}" if section == "things" else ""
            yield section, f"{error}{label}"


def _mistakes(error: ValidationError) -> list[tuple[str, str]]:
    """Return the place of each mistake, and the problem with remedy."""
    mistakes: list[tuple[str, str]] = []
    for detail in error.errors(include_url=False):
        place = ".".join(str(part) for part in detail["loc"])
        mistakes.append((place, _mistake_text(detail)))
    return mistakes


def _mistake_text(detail: ErrorDetails) -> str:
    """Return the problem with remedy in words of maps, since pydantic's are those of programs."""
    loc = detail["loc"]
    kind = detail["type"]
    value = detail["input"]
    model = MapFile if len(loc) == 1 else ENTRIES.get(str(loc[0]), MapFile)

    # Mistakes in an entry
    if kind == "missing":
        return f"is missing; add it beside {join_names(value) or 'the name'}"
    if kind == "extra_forbidden":
        names = join_names(field_names(model))
        if len(loc) == 1:
            return f"is not a section of maps; remove it, or use one of {names}"
        return f"is not known (got {format_value(value)}); remove it, or use one of {names}"
    if kind == "value_error":
        return detail["msg"].removeprefix("Value error, ")

    # A value of another kind than the section or the entry
    if loc == ("links",):
        return f"write a list of {{from: belt, to: belt}}, not {format_value(value)}"
    if loc == ("bays",):
        return f"write a mapping of bays to belts such as {{1: belt}}, not {format_value(value)}"
    if len(loc) == 1:
        return f"write a mapping of names to entries, not {format_value(value)}"
    required: list[str] = []
    for name, field in model.model_fields.items():
        if field.is_required():
            required.append(field.alias or name)
    names = join_names(required or field_names(model))
    return f"write a mapping with {names}, not {format_value(value)}"
