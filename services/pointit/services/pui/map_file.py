"""Reads maps in the YAML format of the ROS toolkit."""

from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, cast

from pydantic import BaseModel, ValidationError

from pointit.runtime.complaint import field_names, listed, more_mistakes, shown
from pointit.runtime.config import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.schemas import Belt, BeltLink, Environment, KeyNameError, Lamp, Strip, encode
from pointit.schemas.topics import check_name
from pointit.services.pui.map_model import BeltEntry, LedEntry, LinkEntry, MapFile, StripEntry

PACKAGE = "pointit.services.pui"
FOLDER = "maps"
SUFFIX = ".yaml"

_ENTRIES: dict[str, type[BaseModel]] = {
    "leds": LedEntry,
    "strips": StripEntry,
    "belts": BeltEntry,
    "links": LinkEntry,
}


def shipped_maps() -> tuple[str, ...]:
    """Return the names of the maps that come with PointIt."""
    entries = files(PACKAGE).joinpath(FOLDER).iterdir()
    return tuple(sorted(entry.name.removesuffix(SUFFIX) for entry in entries if entry.name.endswith(SUFFIX)))


def load_map(name_or_path: str, stamp_ns: int) -> Environment:
    """Return the shipped map of that name, or the one in the file of that path.

    Whatever has a folder or a suffix (`./site.yaml`) is a path, relative to the current directory.

    Raises:
        ConfigError: one sentence with file, key, value and what to do.
    """
    path = Path(name_or_path)
    if path.suffix or len(path.parts) != 1 or name_or_path.endswith("/"):
        return read_map(path, stamp_ns)
    if name_or_path not in shipped_maps():
        raise ConfigError(
            f"map {name_or_path!r} is not shipped: use one of {', '.join(shipped_maps())}, "
            f"or the path of a file such as ./{name_or_path}{SUFFIX}"
        )
    with as_file(files(PACKAGE).joinpath(FOLDER, name_or_path + SUFFIX)) as shipped:
        return read_map(shipped, stamp_ns)


def read_map(path: Path, stamp_ns: int) -> Environment:
    """Return the map in the file at `path`, named as the file.

    Raises:
        ConfigError: one sentence with file, key, value and what to do.
    """
    data = {section: value for section, value in read_yaml(path).items() if value is not None}
    for section in ("leds", "strips", "belts"):
        _check_names(path, section, data.get(section))
    try:
        file = MapFile.model_validate(data)
    except ValidationError as error:
        raise ConfigError(f"{path}: {_sentence(error)}") from error
    if not (file.leds or file.strips or file.belts):
        raise ConfigError(f"{path}: the map is empty; give at least one of leds, strips, belts")
    _check_links(path, file)
    environment = Environment(
        stamp_ns=stamp_ns,
        name=path.stem,
        lamps=tuple(Lamp(id=name, position_m=led.position) for name, led in file.leds.items()),
        strips=tuple(
            Strip(id=name, line_m=strip.line, pixels=strip.pixels, direction=strip.direction)
            for name, strip in file.strips.items()
        ),
        belts=tuple(
            Belt(id=name, line_m=belt.centerline, width_m=belt.width) for name, belt in file.belts.items()
        ),
        links=tuple(BeltLink(source=link.source, target=link.target) for link in file.links),
    )
    size = len(encode(environment))
    if size > Environment.max_bytes:
        raise ConfigError(
            f"{path}: the map has {size} bytes as it travels and at most {Environment.max_bytes} are taken; "
            "split it into several sites"
        )
    return environment


def _check_names(path: Path, section: str, entries: Any) -> None:
    """Refuse names that cannot stand in a key, and names that differ in YAML but not for us (`1`, `"1"`)."""
    if not isinstance(entries, dict):
        return  # the model says so
    seen: set[str] = set()
    for key in cast("dict[object, object]", entries):
        name = str(key)
        try:
            check_name(name)
        except KeyNameError as error:
            raise ConfigError(f"{path}: {section}: {error}") from error
        if name in seen:
            raise ConfigError(f"{path}: {section}: {name} stands there twice; rename one of them")
        seen.add(name)


def _check_links(path: Path, file: MapFile) -> None:
    """Refuse links between lanes that do not exist; strips are the lanes of a map without belts."""
    kind, lanes = ("belt", file.belts.keys()) if file.belts else ("strip", file.strips.keys())
    for index, link in enumerate(file.links):
        for end, name in (("from", link.source), ("to", link.target)):
            if name not in lanes:
                raise ConfigError(
                    f"{path}: links.{index}.{end}: there is no {kind} {name!r}; use one of {listed(lanes)}"
                )


def _sentence(error: ValidationError) -> str:
    """Return the first complaint as key, value and what to do, and how many more there are."""
    details = error.errors(include_url=False)
    loc, kind, value = details[0]["loc"], details[0]["type"], details[0]["input"]
    where = ".".join(str(part) for part in loc)
    model = MapFile if len(loc) == 1 else _ENTRIES[str(loc[0])]
    if kind == "missing":
        text = f"is missing; add it beside {listed(value) or 'the name'}"
    elif kind == "extra_forbidden":
        text = f"is not known (got {shown(value)}); remove it, or use one of {listed(field_names(model))}"
    elif kind == "value_error":
        text = details[0]["msg"].removeprefix("Value error, ")
    elif loc == ("links",):
        text = f"write a list of {{from: belt, to: belt}}, not {shown(value)}"
    elif len(loc) == 1:
        text = f"write a mapping of names to entries, not {shown(value)}"
    else:
        known = [field.alias or name for name, field in model.model_fields.items() if field.is_required()]
        text = f"write a mapping with {listed(known)}, not {shown(value)}"
    return f"{where}: {text}{more_mistakes(len(details) - 1)}"
