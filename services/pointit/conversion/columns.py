"""Columns of a table of messages, derived from their fields: units in the names, one value a cell.

Vectors have a column for each component: `position_m` is `position_x_m`, `position_y_m`, `position_z_m`.
Lists of any length stay one cell, as JSON.
"""

import csv
import json
import re
import types
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Annotated, Any, NamedTuple, Self, Union, get_args, get_origin

from pydantic import TypeAdapter

from pointit.conversion.spreadsheet_text import neutralize_formula
from pointit.runtime.errors import ConfigError
from pointit.schemas.base import SchemaModel

Cell = str | int | float | None

UNITS = {
    "m": "m",
    "rad": "rad",
    "mps": "m/s",
    "mps2": "m/s²",
    "radps": "rad/s",
    "s": "s",
    "ns": "ns",
    "ms": "ms",
    "hz": "Hz",
}
"""Units by the last part of a name."""

AXES = {"xyz": ("x", "y", "z"), "xyzw": ("x", "y", "z", "w"), "uv": ("u", "v")}
"""Components by how names of fields end."""

COLORS = ("r", "g", "b")

PAIRS = {"turn_rad": ("right", "up")}
"""Components of fields of two values by their names."""

_STATE = ("x", "y", "yaw")

COVARIANCE = tuple(
    (f"{a}_{b}", *(("m2", "m²"), ("m_rad", "m·rad"), ("rad2", "rad²"))[(a, b).count("yaw")])
    for a in _STATE
    for b in _STATE
)
"""Components of a `Covariance`: name, unit in the name, unit."""

_LIST = TypeAdapter(Any)

PART = ".part"
"""Suffix of files that are being written. They get their names when all are complete."""

DICTIONARY = "columns.csv"
"""Table that describes the columns of all others."""


class CsvColumn(NamedTuple):
    """One column."""

    name: str
    unit: str
    """As people write it. `""` if it has none."""
    about: str
    get: Callable[[Any], Cell]
    """Returns the cell of a message. None if it is empty."""


def columns_of(kind: type[SchemaModel], without: tuple[str, ...] = ()) -> list[CsvColumn]:
    """Return the columns of the fields of `kind`, except those `without`."""
    return [
        column
        for name, field in kind.model_fields.items()
        if name not in without
        for column in _columns(name, field.annotation, _in_cells(field.description), _getter(name))
    ]


def _in_cells(about: str | None) -> str:
    """Return the description of a field for a table, in which None is an empty cell."""
    return re.sub(r"\bNone\b", "empty", about or "")


def _columns(name: str, annotation: Any, about: str, get: Callable[[Any], Any]) -> Iterator[CsvColumn]:
    plain = _plain(annotation)
    if isinstance(plain, type) and issubclass(plain, SchemaModel):
        for part, field in plain.model_fields.items():
            yield from _columns(
                f"{name}_{part}",
                field.annotation,
                _in_cells(field.description) or about,
                _inside(get, _getter(part)),
            )
        return
    parts = get_args(plain) if get_origin(plain) is tuple else ()
    unit = UNITS.get(name.rpartition("_")[2], "") if "_" in name else ""
    if not parts:
        yield CsvColumn(name, unit, about, _inside(get, _cell))
    elif parts[-1] is Ellipsis:
        yield CsvColumn(name, unit, f"{about}; a JSON list".removeprefix("; "), _inside(get, _json))
    else:
        for index, (title, one) in enumerate(_titles(name, unit, len(parts))):
            yield CsvColumn(title, one, about, _inside(get, _component(index)))


def _titles(name: str, unit: str, count: int) -> list[tuple[str, str]]:
    if name.endswith("covariance"):
        return [(f"{name}_{pair}_{part}", text) for pair, part, text in COVARIANCE]
    base, suffix = (name.rpartition("_")[0], f"_{name.rpartition('_')[2]}") if unit else (name, "")
    head, _, last = base.rpartition("_")
    if last in AXES:
        base, parts = head, AXES[last]
    elif "color" in name:
        parts = COLORS
    else:
        parts = AXES["xyz"] if count == 3 else PAIRS.get(name) or tuple(map(str, range(count)))
    return [(f"{base}_{part}{suffix}".removeprefix("_"), unit) for part in parts]


def _plain(annotation: Any) -> Any:
    while True:
        origin = get_origin(annotation)
        if origin is Annotated:
            annotation = get_args(annotation)[0]
        elif origin in (Union, types.UnionType):
            annotation = next(each for each in get_args(annotation) if each is not type(None))
        else:
            return annotation


def _getter(name: str) -> Callable[[Any], Any]:
    return lambda part: getattr(part, name)


def _component(index: int) -> Callable[[Any], Any]:
    return lambda values: values[index]


def _inside(get: Callable[[Any], Any], of: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def cell(part: Any) -> Any:
        value = get(part)
        return None if value is None else of(value)

    return cell


def _cell(value: Any) -> Cell:
    if isinstance(value, bool):
        return "true" if value else "false"
    return neutralize_formula(value) if isinstance(value, str) else value


def _json(values: Any) -> str:
    return json.dumps(_LIST.dump_python(values, mode="json"), ensure_ascii=False, separators=(",", ":"))


class Tables:
    """A folder of CSV files, opened with their first row, complete or absent.

    As a context manager it completes them; after an exception it removes what it has written.
    """

    def __init__(self, folder: Path, names: Collection[str], *, overwrite: bool) -> None:
        """Create `folder` if need be. Of `names`, those of an earlier export are removed in the end.

        Raises:
            ConfigError: If it cannot be created, or has such files and not `overwrite`.
        """
        self._folder = folder
        self._names = {DICTIONARY, *names}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            found = sorted(name for name in self._names if (folder / name).exists())
        except OSError as error:
            raise ConfigError(f"{folder}: cannot be used as a folder ({error.strerror or error})") from error
        if found and not overwrite:
            more = f" and {len(found) - 1} more" if len(found) > 1 else ""
            raise ConfigError(
                f"{folder}: has {found[0]}{more}; give another folder, or --overwrite to replace tables"
            )
        self._open = ExitStack()
        self._files: dict[str, IO[str]] = {}
        self._writers: dict[str, Any] = {}
        self.rows: dict[str, int] = {}
        """Number of rows by name of the file."""
        self._add(DICTIONARY, ("file", "column", "unit", "description"))

    def create(self, name: str, columns: Sequence[CsvColumn]) -> None:
        """Begin the table `name` and describe its `columns`."""
        self._add(name, [column.name for column in columns])
        for column in columns:
            self.write(DICTIONARY, (name, column.name, column.unit, column.about))

    def write(self, name: str, cells: Sequence[Cell]) -> None:
        """Add a row to a table that was begun."""
        self._writers[name].writerow(cells)
        self.rows[name] += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close all files; give them their names, or remove them after an exception."""
        parts = {name: self._folder / f"{name}{PART}" for name in self._files}
        try:
            self._open.close()  # which writes the rest, and may find the disk full
            if kind is None:
                for name, part in parts.items():
                    part.replace(self._folder / name)
                for name in self._names - set(self._files):
                    (self._folder / name).unlink(missing_ok=True)
        finally:
            for part in parts.values():
                part.unlink(missing_ok=True)

    def _add(self, name: str, titles: Sequence[str]) -> None:
        file = (self._folder / f"{name}{PART}").open("w", encoding="utf-8", newline="")
        self._files[name] = self._open.enter_context(file)
        self._writers[name] = csv.writer(file, lineterminator="\n")
        self._writers[name].writerow(titles)
        self.rows[name] = 0
