"""Columns of a recorded motion in a text file, in SI units, NaN where they are lost.

The columns are `t` (s), `qx qy qz qw`, and positions (m), z up. Empty cells are lost values. The user
declares others.
A `_motion.tsv` of Motion-BIDS, which names no columns, has their names and units in its `_channels.tsv`.
"""

import csv
import datetime as dt
import functools
import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from pointit.geometry.array_types import Array, Mask
from pointit.geometry.rotation import inverse, multiply, rotate
from pointit.maps.text_table import (
    COMMENTS,
    MAX_HEADER_LINES,
    DeclaredColumn,
    TextLayout,
    check_lengths,
    find_layout,
    header_names,
    is_lost,
    parse_columns,
    parse_number,
    split_cells,
)
from pointit.maps.units import LENGTHS_M, TIMES_S, UP_AXES, size_of_unit
from pointit.runtime.config.config import Config
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError
from pointit.schemas import FARTHEST
from pointit.schemas.text import round_beyond, system_reason
from pointit.sim.implausible_positions import (
    find_implausible_positions,
    plausible_axes,
    plausible_units,
    plausible_units_and_axes,
    rotation_matrix,
)
from pointit.sim.time_columns import MAX_PERIOD_S, MIN_PERIOD_S, TimeColumns, counter_bits, unwrapped

TIME = "t"
ORIENTATION = ("qx", "qy", "qz", "qw")
ROBOT = ("robot_x", "robot_y", "robot_z")
HEAD = ("head_x", "head_y", "head_z")
FLOOR = ("px", "py")
ISO = "iso"
"""Unit of times that are dates with a time of day, ISO 8601; UTC if they state no zone."""
MOTION_COLUMNS: dict[str, dict[str, float]] = {
    TIME: {**TIMES_S, ISO: 1.0},
    **{name: {} for name in ORIENTATION},
    **dict.fromkeys((*ROBOT, *HEAD, *FLOOR), LENGTHS_M),
}
"""Names of columns with their units."""
BIDS_SUFFIX = "_motion.tsv"
CHANNELS_SUFFIX = "_channels.tsv"

_POINTS_IN_TIME = re.compile(r"(?<=T)(\d\d)\.(\d\d)\.(\d\d)(?!\d)")
"""Time of day with points, as MetaBase writes it: `2026-11-29T10.53.20.250`."""

MAX_BYTES = 64_000_000
"""Limit of a file: an hour at 1000 Hz. More would use too much memory of a service."""
MAX_TIME_S = 1e12
"""Maximum absolute time, s."""
MAX_STEP_FRAMES = 10
"""Limit of the median step of numbers of frames."""


class MotionForm(Config):
    """Declaration of a file of another form."""

    columns: str = Field(
        default="", description="other columns of the file by name or number, and units: t=time/ms,qx=3"
    )
    lost: str = Field(default="", description="text or number of the file that stands for lost values")
    up: Literal["z", "y", "-y", "x", "-x", "-z"] = Field(
        default="z", description="axis of the file that points up"
    )


DOCUMENTED = MotionForm()


class MotionTable:
    """The columns of a file that are used, in SI units."""

    def __init__(
        self, path: Path, required: Sequence[str], optional: Sequence[Sequence[str]], form: MotionForm
    ) -> None:
        """Read the columns `required`, and those of each group of `optional` that the file names.

        Raises:
            ConfigError: If it cannot be read, is too long, a column is missing, a cell is no number within
                bounds, or there are no rows. Names file, line, column and value, and the parameter.
        """
        self._path = path
        self._form = form
        self.notes: list[str] = []
        """Sentences about what is missing or not used."""
        # Find the columns, and read the rows below their names
        lines, declared = _open(path, form)
        self._first_line = 0 if path.name.endswith(BIDS_SUFFIX) else 1
        try:
            layout = _layout(lines, required, optional, declared)
            self.names = tuple(name for name in MOTION_COLUMNS if name in layout.indices)
            """The columns that were read."""
            self._titles = [_title(layout, layout.indices[name]) for name in self.names]
            self._units = {name: declared[name].unit for name in self.names if name in declared}
            self._time_columns = TimeColumns(lines[layout.skip :], layout)
            values = self._read_rows(lines, layout)
            time_column = declared.get(TIME)
            if time_column is not None and time_column.counter_bits:
                index = self._time_index
                counts = values[:, index]
                values[:, index] = unwrapped(counts, time_column.counter_bits)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from error

        # Note the unused columns: one of them may have been meant
        used = {*layout.indices.values()}
        unused: list[str] = []
        for index, name in enumerate(layout.names):
            if name and index not in used:
                unused.append(name)
        if unused:
            self.notes.append(f"columns {join_names(unused)} are not used")

        # Convert to SI units
        sizes: list[float] = []
        for name in self.names:
            unit = self._units.get(name) or "1"
            sizes.append(size_of_unit(unit, {**MOTION_COLUMNS[name]}))
        self._sizes = np.array(sizes)
        self._values = values * self._sizes
        self._check_bounds()

    def _read_rows(self, lines: Sequence[str], layout: TextLayout) -> Array:
        indices = [layout.indices[name] for name in self.names]
        pick = itemgetter(*indices)
        is_plain = self._units.get(TIME) != ISO
        numbers: list[int] = []
        values: list[list[float]] = []
        first_line = layout.skip + self._first_line
        for line, content in enumerate(lines[layout.skip :], start=first_line):
            is_empty = not content or content.isspace()
            if is_empty or content.startswith(COMMENTS):
                continue
            cells = split_cells(content, layout.delimiter, layout.width)
            layout.check_row(line, cells)
            row = pick(cells)
            numbers.append(line)

            # `float` would read 1_0 as 10: such rows, and dates, are read with more care
            is_safe = is_plain and "_" not in content
            try:
                values.append([*map(float, row if is_safe else ("?",))])
            except ValueError:
                texts = zip(self.names, self._titles, row, strict=True)
                numbers_of_row = [
                    self._parse_cell(line, name, title, text, layout.delimiter) for name, title, text in texts
                ]
                values.append(numbers_of_row)
        if not values:
            raise ConfigError(f"line {layout.skip}: there is a header but no samples")
        self.lines = np.array(numbers, dtype=np.int64)
        """n: line in the file of each row."""
        return np.array(values, dtype=np.float64)

    def _parse_cell(self, line: int, name: str, title: str, text: str, delimiter: str) -> float:
        """Return the number in a cell, NaN if it is lost."""
        value = parse_number(text, delimiter)
        if name == TIME:
            is_date = self._units.get(TIME) == ISO
            if is_date:
                value = _iso_time_s(text)
            if not math.isnan(value):
                return value
            remedy = "write it, or set columns to t=iso if the column has dates and times"
            if is_date:
                remedy = "write it in ISO 8601, such as 2026-11-29T10:53:20.250"
            remedy += self._time_columns.alternatives(title)
        else:
            if not math.isnan(value) or is_lost(text):
                return value
            if text == self._form.lost:
                return value
            remedy = f"correct it, or set lost to {format_value(text[:20])} if it stands for lost values"
        value_text = format_value(text)
        raise ConfigError(f"line {line}, column {title!r}: a number was expected, got {value_text}; {remedy}")

    def _check_bounds(self) -> None:
        limits = [MAX_TIME_S if name == TIME else FARTHEST for name in self.names]
        is_time = [name == TIME for name in self.names]
        is_beyond = np.abs(self._values) > limits
        is_missing = np.isnan(self._values) & is_time
        for row, column in np.argwhere(is_beyond | is_missing)[:1].tolist():
            value = self._values[row, column]
            cell = self._cell(row, self._titles[column])
            raise ConfigError(
                f"{cell}: {value:.10g} is not within {limits[column]:g}; set columns to its unit, or lost to "
                "it"
            )

    def _line_of(self, row: int) -> str:
        return f"{self._path}, line {self.lines[row]}"

    def _cell(self, row: int, title: str) -> str:
        return f"{self._line_of(row)}, column {title!r}"

    def _column_range(self, names: Sequence[str]) -> str:
        return f"{self.title(names[0])!r} to {self.title(names[-1])!r}"

    @property
    def _time_index(self) -> int:
        return self.names.index(TIME)

    @property
    def _time_size_s(self) -> float:
        return float(self._sizes[self._time_index])

    def title(self, name: str) -> str:
        """Return the name of a column in the file."""
        return self._titles[self.names.index(name)]

    def times(self) -> Array:
        """Return the times, n, s.

        Raises:
            ConfigError: If they do not rise, or are not plausible as seconds.
        """
        times_s: Array = self._values[:, self._time_index]
        title = self.title(TIME)
        is_rising = np.diff(times_s) > 0.0
        wrong_rows = np.flatnonzero(~is_rising) + 1
        for row in wrong_rows[:1].tolist():
            remedy = self._remedy_of_order(times_s, row)
            previous_s, time_s = times_s[row - 1 : row + 1]
            cell = self._cell(row, title)
            raise ConfigError(
                f"{cell}: time does not increase, {time_s:.12g} after {previous_s:.12g} s; {remedy}"
            )

        # Of two rows the period says nothing
        if len(times_s) <= 2:
            return times_s
        period_s = float(np.median(np.diff(times_s)))
        if not MIN_PERIOD_S <= period_s <= MAX_PERIOD_S:
            remedy = self._remedy_of_times(period_s)
            limits = f"{MIN_PERIOD_S:g} to {MAX_PERIOD_S:g} s"
            raise ConfigError(
                f"{self._path}, column {title!r}: samples are {period_s:.6g} s apart, plausible are "
                f"{limits}; {remedy}"
            )
        return times_s

    def _remedy_of_order(self, times_s: Array, row: int) -> str:
        """Return the remedy for times that do not rise, first at `row`."""
        title = self.title(TIME)
        alternatives = self._time_columns.alternatives(title)
        steps_s = np.diff(times_s)
        falls = int((steps_s < 0.0).sum())
        if not falls:
            repeats = int((steps_s == 0.0).sum())
            rows = "the row" if repeats == 1 else f"the {repeats} rows that repeat a time"
            return f"write more digits, or remove {rows}{alternatives}"
        numbers = times_s / self._time_size_s
        previous, number = numbers[row - 1 : row + 1]
        bits = counter_bits(float(previous), float(number))
        unit = self._units.get(TIME) or "s"
        if bits and unit != ISO:
            return (
                f"set columns to {TIME}={title}/{unit}/{bits}bit if it is a counter of {bits} bits that "
                f"starts again{alternatives}"
            )
        order = "cut the file there into two" if falls == 1 else "sort its rows by time"
        return f"{order}{alternatives}"

    def _remedy_of_times(self, period_s: float) -> str:
        """Return the remedy for samples `period_s` apart: the units with which they are plausible."""
        spacing = period_s / self._time_size_s
        if self._units.get(TIME) == ISO:
            return "record at another rate"
        column = f"{TIME}={self.title(TIME)}"
        units: list[str] = []
        for unit, size_s in TIMES_S.items():
            spacing_s = spacing * size_s
            if MIN_PERIOD_S <= spacing_s <= MAX_PERIOD_S:
                units.append(f"{column}/{unit} ({spacing_s:.4g} s apart)")
        if 1.0 <= spacing < MAX_STEP_FRAMES:
            units.append(f"{column}/0.01 for numbers of frames at 100 Hz")
        return f"set columns to its unit: {' or '.join(units)}" if units else "record at another rate"

    def vectors(self, body: str, names: Sequence[str]) -> Array:
        """Return columns side by side, n x k, SI, z up. Rows in which the body is lost are NaN, and noted.

        Raises:
            ConfigError: If all are 0 in a row, which stands for "lost" in many programs.
        """
        indices = [self.names.index(name) for name in names]
        vectors = self._values[:, indices]
        columns = self._column_range(names)

        # Rows in which the body is lost: a number is missing, or all are the declared mark
        marks = parse_number(self._form.lost, " ") * self._sizes[indices]
        is_missing = ~np.isfinite(vectors).all(axis=1)
        is_lost_row = is_missing | (vectors == marks).all(axis=1)
        is_zero = (vectors == 0.0).all(axis=1)
        zeros = np.flatnonzero(is_zero & ~is_lost_row)
        if len(zeros) and not self._form.lost:
            place = self._line_of(int(zeros[0]))
            raise ConfigError(
                f"{place}, columns {columns}: are all 0; set lost to 0 if the {body} is lost there, or to "
                "nan if it is not"
            )
        if is_lost_row.any():
            rows = self._rows_text(is_lost_row)
            self.notes.append(f"{body} ({columns}): missing in {rows}; left out")

        # Turn z up
        turned: Array = vectors.copy()
        if self._form.up != "z" and len(names) > 2:
            turn_one = multiply if len(names) == 4 else rotate
            turn = functools.partial(turn_one, UP_AXES[self._form.up])
            turned = np.array([turn(row) for row in vectors.tolist()])
        turned[is_lost_row] = np.nan
        return turned

    def check_positions(self, body: str, names: Sequence[str], positions: Array, times_s: Array) -> None:
        """Check that `positions` of a body, n x k, NaN where it is lost, are plausible as metres, z up.

        Raises:
            ConfigError: If they are not.
        """
        problem = find_implausible_positions(body, positions, times_s)
        if problem is None:
            return
        row, clause = problem
        place = f"{self._path}" if row is None else self._line_of(row)
        columns = self._column_range(names)
        remedies = self._remedies_of_positions(body, names, positions, times_s)
        if row is not None:
            remedies.append("lost to the number that stands for lost bodies")
        settings = ", or ".join(remedies)
        raise ConfigError(f"{place}, columns {columns}: the {body} {clause}; set {settings}")

    def _remedies_of_positions(
        self, body: str, names: Sequence[str], positions: Array, times_s: Array
    ) -> list[str]:
        """Return the declarations of unit and axis with which `positions` are plausible."""
        remedies: list[str] = []

        # Another unit, with which all is plausible
        size = float(self._sizes[self.names.index(names[0])])
        distances_m = plausible_units(body, positions, times_s, size)
        if distances_m:
            unit = next(iter(distances_m))
            declarations = [f"{name}={self.title(name)}/{unit}" for name in names]
            example = ",".join(declarations)
            fitting = [f"{unit} ({distance_m:.3g} m away)" for unit, distance_m in distances_m.items()]
            plausible = join_names(fitting)
            remedies.append(f"columns to their unit, such as {example}, plausible are {plausible}")

        # Another axis, or both
        if len(names) > 2:
            up = self._form.up
            in_file = positions @ rotation_matrix(inverse(UP_AXES[up]))
            axes = plausible_axes(body, in_file, times_s)
            if axes:
                remedies.append(f"up to the axis that points up, {join_names(axes)}")
            both: list[str] = []
            if body == "head":
                both = plausible_units_and_axes(in_file, times_s, size, up)
            if both:
                remedies.append(f"both, plausible are {join_names(both)}")
        return remedies or [f"columns to those of the {body}"]

    def _rows_text(self, is_row: Mask) -> str:
        """Return the number of rows, gaps and the first line of the rows `is_row`."""
        times_s = self._values[:, self._time_index]
        edges = np.diff(is_row.astype(int), prepend=0, append=0)
        ends = np.flatnonzero(edges).reshape(-1, 2)

        # A gap lasts from the sample before it to the one after it
        starts, stops = ends.T
        before = np.maximum(starts - 1, 0)
        after = np.minimum(stops, len(times_s) - 1)
        longest_s = float((times_s[after] - times_s[before]).max())
        plural = "" if len(ends) == 1 else "s"
        gaps = f"{len(ends)} gap{plural} of up to {longest_s:.2f} s"
        first_line = self.lines[int(ends[0][0])]
        return f"{is_row.sum()} of {len(is_row)} rows, {gaps}, the first in line {first_line}"


def _title(layout: TextLayout, index: int) -> str:
    """Return the name of a column for people, which is its number if the file names none."""
    if not layout.names:
        return f"{index + 1}"
    return f"{layout.names[index]}"


def has_columns(path: Path, names: Sequence[str], form: MotionForm = DOCUMENTED) -> bool:
    """Return True if the file at `path` has the columns `names`."""
    try:
        lines, declared = _open(path, form)
        _layout(lines, names, (), declared)
    except ConfigError:
        return False
    return True


def _open(path: Path, form: MotionForm) -> tuple[list[str], dict[str, DeclaredColumn]]:
    """Return the lines of a file, with names of columns, and declared columns."""
    lines = _read_text(path).splitlines()
    lines = list(check_lengths(lines, f"{path}: "))
    names = frozenset[str]()
    if "/" in form.columns:  # it divides name and unit, but may also belong to a name of the file
        names = header_names(lines[:MAX_HEADER_LINES])
    declared = parse_columns(form.columns, MOTION_COLUMNS, names, counters=(TIME,))
    if not path.name.endswith(BIDS_SUFFIX):
        return lines, declared
    lines, channels = _with_channels(path, lines)
    return lines, _declare_channels(channels, declared)


def _layout(
    lines: Sequence[str],
    required: Sequence[str],
    optional: Sequence[Sequence[str]],
    declared: Mapping[str, DeclaredColumn],
) -> TextLayout:
    """Return the structure of a file with the columns `required` and groups of `optional` ones.

    Raises:
        ConfigError: If it does not have them, or a part of a group.
    """
    # Required groups, and optional ones of which a column is declared, must be there
    known = {*required, *itertools.chain(*optional)}
    groups = [required]
    for group in optional:
        if declared.keys() & {*group}:
            groups.append(group)
    names = [*itertools.chain(*groups)]
    wanted: dict[str, str | int] = dict(zip(names, names, strict=True))
    for name, column in declared.items():
        if name in known:
            wanted[name] = column.source

    # Dates are no numbers, so that another column shows where the rows begin
    is_date = TIME in declared and declared[TIME].unit == ISO
    anchors: Sequence[str] = (TIME,)
    texts: Sequence[str] = ()
    if is_date:
        anchors = required[1:2]
        texts = (TIME,)
    optional_columns = sorted(known - wanted.keys())
    layout = find_layout(
        lines[:MAX_HEADER_LINES],
        wanted,
        optional=optional_columns,
        anchors=anchors,
        texts=texts,
        remedy=_remedy(required),
    )

    # A part of a group is a mistake
    for group in optional:
        missing = {*group} - layout.indices.keys()
        if 0 < len(missing) < len(group):
            columns = join_names(sorted(missing))
            raise ConfigError(f"there is no column {columns}; {_remedy(group)}")
    return layout


def _remedy(required: Sequence[str]) -> str:
    numbers = [f"{name}={number}" for number, name in enumerate(required, start=1)]
    numbered = ",".join(numbers)
    angles = ", and quaternions, as angles are not read" if "qx" in required else ""
    return (
        f"set columns to those of the file by name or number, such as {numbered}, with their units, such "
        f"as t=1/ms or t=1/iso for dates{angles}"
    )


def _read_text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            size_mb = round_beyond(size / 1e6, MAX_BYTES / 1e6)
            raise ConfigError(
                f"{path}: has {size_mb} MB and at most {MAX_BYTES / 1e6:.0f} MB are read; cut it into pieces"
            )
        text = path.read_text("utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({system_reason(error)})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text; save it as CSV in UTF-8") from error
    if "\0" in text:
        raise ConfigError(f"{path}: has zero bytes; save it as CSV in UTF-8")
    return text


def _iso_time_s(text: str) -> float:
    """Return a date with time, s since 1970, NaN if it is none."""
    try:
        time = dt.datetime.fromisoformat(_POINTS_IN_TIME.sub(r"\1:\2:\3", text))
    except ValueError:
        return math.nan
    if not time.tzinfo:
        time = time.replace(tzinfo=dt.UTC)
    return time.timestamp()


def _with_channels(path: Path, lines: Sequence[str]) -> tuple[list[str], list[dict[str, str]]]:
    """Return the lines of a `_motion.tsv` below the names of its channels, and the rows of `_channels.tsv`.

    Without a channel of times, rows have those of the sampling frequency in `_motion.json`.
    """
    beside = path.with_name(path.name.removesuffix(BIDS_SUFFIX) + CHANNELS_SUFFIX)
    rows = csv.DictReader(_read_text(beside).splitlines(), delimiter="\t", restval="")
    channels = list(rows)
    columns = channels[0] if channels else {}
    missing = [name for name in ("name", "component", "type", "units") if name not in columns]
    if missing:
        raise ConfigError(f"{beside}: has no column {join_names(missing)}; correct it as Motion-BIDS says")

    # Times, if no channel has them
    if all(channel["type"] != "LATENCY" for channel in channels):
        sidecar = path.with_suffix(".json")
        try:
            content = json.loads(_read_text(sidecar))
            rate_hz = float(content["SamplingFrequency"])
            lines = [f"{line}\t{row / rate_hz:.9f}" for row, line in enumerate(lines)]
        except (ValueError, TypeError, KeyError, ArithmeticError):
            raise ConfigError(
                f"{sidecar}: has no SamplingFrequency above 0, and {beside.name} no LATENCY; add one"
            ) from None
        channels.append({"name": TIME, "component": "n/a", "type": "LATENCY", "units": "s"})
    header = "\t".join(channel["name"] for channel in channels)
    return [header, *lines], channels


def _declare_channels(
    channels: Sequence[Mapping[str, str]], declared: Mapping[str, DeclaredColumn]
) -> dict[str, DeclaredColumn]:
    """Return `declared`, and the channels of time and orientation, with the units of `channels`.

    Raises:
        ConfigError: If the unit of one is unknown.
    """
    # Channels by their type and component, if only one has them
    kinds = {name: ("ORNT", f"quat_{name[1]}") for name in ORIENTATION}
    kinds = {TIME: ("LATENCY", "n/a")} | kinds
    columns = dict(declared)
    for ours, kind in kinds.items():
        names: list[str] = []
        for channel in channels:
            if (channel["type"], channel["component"].lower()) == kind:
                names.append(channel["name"])
        if len(names) == 1:
            columns.setdefault(ours, DeclaredColumn(names[0]))

    # Their units, unless a person has declared others
    units = {channel["name"]: channel["units"] for channel in channels}
    for ours, column in columns.items():
        unit = units.get(str(column.source), "n/a")
        if column.unit or unit == "n/a":
            continue
        if not MOTION_COLUMNS[ours]:
            continue
        if unit not in MOTION_COLUMNS[ours]:
            raise ConfigError(
                f"channel {column.source} has the unit {format_value(unit)}; set columns to its size in SI "
                f"units, such as {ours}={column.source}/0.001"
            )
        columns[ours] = column._replace(unit=unit)
    return columns


def rows_of(vectors: Array) -> Iterator[tuple[int, list[float]]]:
    """Yield number and values of the rows of `vectors` without NaN."""
    is_complete = np.isfinite(vectors).all(axis=1)
    for row in np.flatnonzero(is_complete).tolist():
        yield row, vectors[row].tolist()
