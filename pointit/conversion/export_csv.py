"""A recording as tidy CSV files, with columns derived from the fields of messages.

Vectors have a column for each component: `position_m` is `position_x_m`, `position_y_m`, `position_z_m`.
Lists of any length stay one cell, as JSON.
"""

import csv
import json
import re
import types
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, Any, NamedTuple, Self, Union, get_args, get_origin

from pydantic import TypeAdapter

from pointit.conversion.acts import ActDetector, PointingAct, SelectionCsvRow
from pointit.recording.entries import Entry, Exchange
from pointit.runtime.errors import ConfigError
from pointit.schemas import (
    NS_PER_S,
    ActOutcome,
    Cursor,
    Hover,
    Message,
    SelectionEvent,
    TrackedObject,
    TrackedObjects,
    topics,
)
from pointit.schemas.base import SchemaModel
from pointit.schemas.text import first_of, system_reason

Cell = str | int | float | None

UNSAFE = ("=", "+", "-", "@", "\t", "\r")
"""Beginnings of a text that spreadsheets take for a formula; an apostrophe is put before it."""
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

FILES = {
    topics.IMU.key: "imu.csv",
    topics.WRIST.key: "wrists.csv",
    topics.BUTTON.key: "buttons.csv",
    topics.RAY.key: "rays.csv",
    topics.POSE.key: "poses.csv",
    topics.PROFILE.key: "profiles.csv",
    topics.LOCALIZATION.key: "localizations.csv",
    topics.ANCHOR.key: "anchors.csv",
    topics.CURSOR.key: "cursors.csv",
    topics.HOVER.key: "hovers.csv",
    topics.INTERACTION.key: "interactions.csv",
    topics.FEEDBACK.key: "cues.csv",
    topics.GOAL.key: "goals.csv",
    topics.OBJECTS.key: "objects.csv",
    topics.SELECTION_EVENTS.key: "events.csv",
    topics.OUTCOMES.key: "outcomes.csv",
    topics.LAMP_COLOR.key: "lamps.csv",
    topics.CONVEYOR_STATE.key: "conveyor.csv",
}
"""Tables of the streams, by the topic's key. Other topics, such as pixels and health, are no tables."""

SELECTIONS = "selections.csv"
ACTS = "acts.csv"
REQUESTS = "requests.csv"
NAMES = (SELECTIONS, ACTS, REQUESTS, *FILES.values())

TICK = 1000
"""Entries between two reports of progress."""


def neutralize_formula(text: str) -> str:
    """Return `text` so that no spreadsheet takes it for a formula."""
    return f"'{text}" if text.lstrip("'").startswith(UNSAFE) else text


def restore_formula(text: str) -> str:
    """Return the text of which `neutralize_formula` has made `text`."""
    return text[1:] if text.startswith("'") and text.lstrip("'").startswith(UNSAFE) else text


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
    columns: list[CsvColumn] = []
    for name, field in kind.model_fields.items():
        if name not in without:
            about = _in_cells(field.description)
            columns += _columns_of_field(name, field.annotation, about, _getter(name))
    return columns


def _in_cells(about: str | None) -> str:
    """Return the description of a field for a table, in which None is an empty cell."""
    return re.sub(r"\bNone\b", "empty", about or "")


def _columns_of_field(
    name: str, annotation: Any, about: str, get: Callable[[Any], Any]
) -> Iterator[CsvColumn]:
    plain = _plain(annotation)

    # A model within the message: its fields.
    if isinstance(plain, type) and issubclass(plain, SchemaModel):
        for part, field in plain.model_fields.items():
            part_about = _in_cells(field.description) or about
            part_get = _inside(get, _getter(part))
            yield from _columns_of_field(f"{name}_{part}", field.annotation, part_about, part_get)
        return

    # One value, a list of any length, or a vector with a column for each component.
    parts = get_args(plain) if get_origin(plain) is tuple else ()
    unit = UNITS.get(name.rpartition("_")[2], "") if "_" in name else ""
    if not parts:
        yield CsvColumn(name, unit, about, _inside(get, _cell))
    elif parts[-1] is Ellipsis:
        yield CsvColumn(name, unit, f"{about}; a JSON list".removeprefix("; "), _inside(get, _json))
    else:
        for index, (title, component_unit) in enumerate(_titles(name, unit, len(parts))):
            yield CsvColumn(title, component_unit, about, _inside(get, _component(index)))


def _titles(name: str, unit: str, count: int) -> list[tuple[str, str]]:
    """Return title and unit of the columns of a vector with `count` components."""
    if name.endswith("covariance"):
        return [(f"{name}_{pair}_{part}", text) for pair, part, text in COVARIANCE]

    # The unit stays the end of the title: `position_m` has `position_x_m`.
    base = name
    suffix = ""
    if unit:
        base, _, last = name.rpartition("_")
        suffix = f"_{last}"

    head, _, axes = base.rpartition("_")
    if axes in AXES:
        base = head
        components = AXES[axes]
    elif "color" in name:
        components = COLORS
    elif count == 3:
        components = AXES["xyz"]
    elif name in PAIRS:
        components = PAIRS[name]
    else:
        components = tuple(map(str, range(count)))
    return [(f"{base}_{component}{suffix}".removeprefix("_"), unit) for component in components]


def _plain(annotation: Any) -> Any:
    while True:
        origin = get_origin(annotation)
        if origin is Annotated:
            annotation = get_args(annotation)[0]
        elif origin in (Union, types.UnionType):
            annotation = next(member for member in get_args(annotation) if member is not type(None))
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
    if isinstance(value, str):
        return neutralize_formula(value)
    return value


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
            earlier = sorted(name for name in self._names if (folder / name).exists())
        except OSError as error:
            raise ConfigError(f"{folder}: cannot be used as a folder ({system_reason(error)})") from error
        if earlier and not overwrite:
            raise ConfigError(
                f"{folder}: has {first_of(earlier, 1)}; give another folder, or --overwrite to replace tables"
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


@dataclass(frozen=True, kw_only=True)
class Exported:
    """Numbers of what was written and left out."""

    rows: dict[str, int]
    """Number of rows by name of the file."""
    left_out: dict[str, int]
    """Number of messages by topic, such as `strips/frame`, of those that are no table."""


def export_csv(
    entries: Iterable[Entry],
    began_ns: int,
    folder: Path,
    *,
    overwrite: bool = False,
    tick: Callable[[int], None] = lambda _: None,
) -> Exported:
    """Write `entries` of a recording to CSV files in `folder`, one after the other.

    A file is complete or absent: nothing stays of an export that fails.

    Args:
        entries: in order of time.
        began_ns: beginning of the recording, Unix ns, from which columns in seconds count.
        folder: created if it does not exist.
        overwrite: replace tables that are there.
        tick: called with the number of entries so far.

    Raises:
        ConfigError: If the folder has tables and may not be overwritten, or cannot be written.
    """
    try:
        # Leaving the context gives the files their names, or removes them after an exception.
        with Tables(folder, NAMES, overwrite=overwrite) as tables:
            export = _Export(tables, began_ns)
            for count, entry in enumerate(entries):
                export.add(entry)
                if count % TICK == 0:
                    tick(count)
            export.end()
            return Exported(rows=tables.rows, left_out=dict(export.left_out))
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written ({system_reason(error)})") from error


class _Export:
    def __init__(self, tables: Tables, began_ns: int) -> None:
        self._tables = tables
        self._began_ns = began_ns
        self._detector = ActDetector(began_ns)
        self._acts = columns_of(PointingAct)
        self._selections = columns_of(SelectionCsvRow)
        tables.create(SELECTIONS, self._selections)
        tables.create(ACTS, self._acts)
        self._columns: dict[str, list[CsvColumn]] = {}
        self.left_out: Counter[str] = Counter()

    def add(self, entry: Entry) -> None:
        row = entry.row
        body = entry.body
        if isinstance(row, topics.Request) and isinstance(body, Exchange):
            self._request(entry.key, body)
        elif isinstance(row, topics.Topic) and isinstance(body, Message):
            if row.key in FILES:
                self._message(row, entry.name, body)
                self._follow(entry.name, body)
            else:
                self.left_out[row.key] += 1

    def end(self) -> None:
        self._detector.end()
        self._write_acts()

    def _message(self, row: topics.Topic[Any], name: str, message: Message) -> None:
        file = FILES[row.key]
        columns = self._columns.get(row.key)
        if columns is None:
            columns = _columns(row)
            self._columns[row.key] = columns
            self._tables.create(file, columns)

        # The first cells are the same in all rows of a message: times, and who or what it is about.
        time_s = (message.stamp_ns - self._began_ns) / NS_PER_S
        first: list[Cell] = [time_s, message.stamp_ns]
        if row.placeholder:
            first.append(neutralize_formula(name))
        rest = columns[len(first) :]
        parts = message.objects if isinstance(message, TrackedObjects) else (message,)
        for part in parts:
            cells = [column.get(part) for column in rest]
            self._tables.write(file, [*first, *cells])

    def _follow(self, name: str, message: Message) -> None:
        match message:
            case Cursor():
                self._detector.on_cursor(name, message)
            case Hover():
                self._detector.on_hover(name, message)
            case TrackedObjects():
                self._detector.on_objects(name, message)
            case SelectionEvent():
                self._detector.on_event(message)
            case ActOutcome():
                self._detector.on_outcome(message)
            case _:
                return
        self._write_acts()

    def _write_acts(self) -> None:
        for act in self._detector.acts:
            self._tables.write(ACTS, [column.get(act) for column in self._acts])
        for selection in self._detector.selections:
            self._tables.write(SELECTIONS, [column.get(selection) for column in self._selections])
        self._detector.acts.clear()
        self._detector.selections.clear()

    def _request(self, key: str, exchange: Exchange[Any, Any]) -> None:
        if REQUESTS not in self._tables.rows:
            self._tables.create(REQUESTS, _REQUEST_COLUMNS)
        stamp_ns = exchange.stamp_ns
        reply = exchange.reply
        cells = (
            (stamp_ns - self._began_ns) / NS_PER_S,
            stamp_ns,
            key,
            exchange.query.model_dump_json(),
            None if reply is None else reply.model_dump_json(),
            neutralize_formula(exchange.refusal),
        )
        self._tables.write(REQUESTS, cells)


def _nothing(_: Any) -> None:
    """Return nothing: such a column is filled in without the message."""


_TIME = (
    CsvColumn("time_s", "s", "time of capture, since the recording began", _nothing),
    CsvColumn("stamp_ns", "ns", "time of capture, Unix time", _nothing),
)

_REQUEST_COLUMNS = (
    *_TIME,
    CsvColumn("request", "", "its key", _nothing),
    CsvColumn("query", "", "what was asked, JSON", _nothing),
    CsvColumn("reply", "", "the answer, JSON; empty if it was refused", _nothing),
    CsvColumn("refusal", "", "reason of a refusal", _nothing),
)


def _columns(row: topics.Topic[Any]) -> list[CsvColumn]:
    """Return the columns of a topic's table: time, what the placeholder stands for, the message's fields."""
    first = list(_TIME)
    if row.placeholder:
        first.append(
            CsvColumn(row.placeholder, "", f"{{{row.placeholder}}} in the topic {row.key}", _nothing)
        )
    kind = TrackedObject if row.message is TrackedObjects else row.message
    return [*first, *columns_of(kind, without=("stamp_ns",))]
