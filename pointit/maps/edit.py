"""Edits of a map: what changes are its entries, and with them only the characters that hold them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import BaseModel, ConfigDict, Field

from pointit.maps.model import ENTRIES
from pointit.runtime.config.yaml_edit import DIGITS, Data, with_values
from pointit.runtime.config.yaml_file import parse_yaml, written_text
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import part_of_file, rename_to_new
from pointit.schemas.text import system_reason

Section = Annotated[str, Field(pattern=f"^({'|'.join(name for name in ENTRIES if name != 'links')})$")]
"""A section of named entries."""

EntryName = Annotated[str, Field(min_length=1, max_length=64)]
Key = Annotated[str, Field(min_length=1, max_length=64)]
Names = dict[str, dict[str, str]]
"""New names of entries by section and old name."""
OLD_NAMES = {"leds": "lamps"}
"""Sections by the names that they had in older files."""


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


def edited(content: bytes, edits: Sequence[Edit], path: Path) -> bytes:
    """Return the text of the map at `path` after `edits`, which name entries as they are in `content`.

    Raises:
        ConfigError: If `content` is not YAML.
        RefusedError: If an entry is not there, a name would be there twice, a number is not finite, or
            the file's form does not allow a change in place.
    """
    wanted = _data(content, path)
    names = _apply(wanted, edits)
    return with_values(content, wanted, path, names, old_names=OLD_NAMES)


def _data(content: bytes, path: Path) -> Data:
    data = cast("Data", _plain(parse_yaml(content, path)))
    for old_name, name in OLD_NAMES.items():
        if name not in data and old_name in data:
            data[name] = data.pop(old_name)
    return data


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
