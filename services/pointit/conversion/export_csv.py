"""A recording as tidy CSV files: one row a selection, one a pointing act, one a message of each stream."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pointit.conversion.acts import Act, ActDetector, SelectionCsvRow
from pointit.conversion.columns import CsvColumn, Tables, columns_of
from pointit.conversion.spreadsheet_text import neutralize_formula
from pointit.recording.entries import Entry, Exchange
from pointit.runtime.errors import ConfigError
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Hover,
    Message,
    SelectionEvent,
    TrackedObject,
    TrackedObjects,
    topics,
)

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
    topics.LAMP_COLOR.key: "lamps.csv",
    topics.CONVEYOR_STATE.key: "conveyor.csv",
}
"""Tables of the streams, by the topic's key. Other topics, such as pixels and health, are no tables."""

SELECTIONS, ACTS, REQUESTS = "selections.csv", "acts.csv", "requests.csv"
NAMES = (SELECTIONS, ACTS, REQUESTS, *FILES.values())

TICK = 1000
"""Entries between two reports of progress."""


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
        with Tables(folder, NAMES, overwrite=overwrite) as tables:
            export = _Export(tables, began_ns)
            for count, entry in enumerate(entries):
                export.add(entry)
                if count % TICK == 0:
                    tick(count)
            export.end()
            return Exported(rows=tables.rows, left_out=dict(export.left_out))
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written ({error.strerror or error})") from error


class _Export:
    def __init__(self, tables: Tables, began_ns: int) -> None:
        self._tables = tables
        self._began_ns = began_ns
        self._detector = ActDetector(began_ns)
        self._acts, self._selections = columns_of(Act), columns_of(SelectionCsvRow)
        tables.create(SELECTIONS, self._selections)
        tables.create(ACTS, self._acts)
        self._columns: dict[str, list[CsvColumn]] = {}
        self.left_out: Counter[str] = Counter()

    def add(self, entry: Entry) -> None:
        row, body = entry.row, entry.body
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
        columns = self._columns.get(row.key)
        if columns is None:
            columns = self._columns[row.key] = _columns(row)
            self._tables.create(FILES[row.key], columns)
        time = (neutralize_formula(name),) if row.placeholder else ()
        first = ((message.stamp_ns - self._began_ns) / NS_PER_S, message.stamp_ns, *time)
        rest = columns[len(first) :]
        parts = message.objects if isinstance(message, TrackedObjects) else (message,)
        for part in parts:
            self._tables.write(FILES[row.key], (*first, *[column.get(part) for column in rest]))

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
        stamp_ns, reply = exchange.stamp_ns, exchange.reply
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
