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
from pointit.geometry.rotation import Quaternion, inverse, multiply, rotate
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
from pointit.schemas.text import round_beyond
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
MAX_DISTANCE_M = 100.0
"""Maximum distance from the origin."""
HEAD_RANGE_M = (0.5, 3.0)
"""Limits of the median height of a head over the floor."""
MAX_BELOW_FLOOR_M = 3.0
"""Maximum depth of a body below the floor, as of a file with another axis up."""
MAX_SPEED_MPS = 30.0
"""Maximum speed, which 90 % of the steps of a body keep to."""


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
        lines, declared = _open(path, form)
        self._first_line = 0 if path.name.endswith(BIDS_SUFFIX) else 1
        try:
            layout = _layout(lines, required, optional, declared)
            self.names = tuple(name for name in MOTION_COLUMNS if name in layout.indices)
            """The columns that were read."""
            self._titles = [
                f"{layout.names[at] if layout.names else at + 1}"
                for at in (layout.indices[name] for name in self.names)
            ]
            self._units = {name: declared[name].unit for name in self.names if name in declared}
            self._time_columns = TimeColumns(lines[layout.skip :], layout)
            values = self._read_rows(lines, layout)
            if TIME in declared and declared[TIME].counter_bits:
                at = self.names.index(TIME)
                values[:, at] = unwrapped(values[:, at], declared[TIME].counter_bits)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from error
        unused = [name for at, name in enumerate(layout.names) if name and at not in layout.indices.values()]
        if unused:
            self.notes.append(f"columns {join_names(unused)} are not used")
        self._sizes = np.array(
            [size_of_unit(self._units.get(name) or "1", {**MOTION_COLUMNS[name]}) for name in self.names]
        )
        self._values = values * self._sizes
        self._check_bounds()

    def _read_rows(self, lines: Sequence[str], layout: TextLayout) -> Array:
        pick = itemgetter(*(layout.indices[name] for name in self.names))
        is_plain = self._units.get(TIME) != ISO
        numbers: list[int] = []
        values: list[list[float]] = []
        for line, content in enumerate(lines[layout.skip :], start=layout.skip + self._first_line):
            if not content or content.isspace() or content.startswith(COMMENTS):
                continue
            cells = split_cells(content, layout.delimiter, layout.width)
            layout.check_row(line, cells)
            row = pick(cells)
            numbers.append(line)
            try:
                values.append([*map(float, row if is_plain and "_" not in content else ("?",))])
            except ValueError:
                texts = zip(self.names, self._titles, row, strict=True)
                values.append([self._number(line, *each, layout.delimiter) for each in texts])
        if not values:
            raise ConfigError(f"line {layout.skip}: there is a header but no samples")
        self.lines = np.array(numbers, dtype=np.int64)
        """n: line in the file of each row."""
        return np.array(values, dtype=np.float64)

    def _number(self, line: int, name: str, title: str, text: str, delimiter: str) -> float:
        """Return the number in a cell, NaN if it is lost."""
        value = parse_number(text, delimiter)
        if name == TIME:
            value = _iso_time_s(text) if self._units.get(TIME) == ISO else value
            if not math.isnan(value):
                return value
            remedy = "write it, or set columns to t=iso if the column has dates and times"
            if self._units.get(TIME) == ISO:
                remedy = "write it in ISO 8601, such as 2026-11-29T10:53:20.250"
            remedy += self._time_columns.alternatives(title)
        elif not math.isnan(value) or is_lost(text) or text == self._form.lost:
            return value
        else:
            remedy = f"correct it, or set lost to {format_value(text[:20])} if it stands for lost values"
        raise ConfigError(
            f"line {line}, column {title!r}: a number was expected, got {format_value(text)}; {remedy}"
        )

    def _check_bounds(self) -> None:
        limits = [MAX_TIME_S if name == TIME else FARTHEST for name in self.names]
        is_wrong = (np.abs(self._values) > limits) | (
            np.isnan(self._values) & [name == TIME for name in self.names]
        )
        for row, column in np.argwhere(is_wrong)[:1].tolist():
            raise ConfigError(
                f"{self._at(row)}, column {self._titles[column]!r}: {self._values[row, column]:.10g} is "
                f"not within {limits[column]:g}; set columns to its unit, or lost to it"
            )

    def _at(self, row: int) -> str:
        return f"{self._path}, line {self.lines[row]}"

    def title(self, name: str) -> str:
        """Return the name of a column in the file."""
        return self._titles[self.names.index(name)]

    def times(self) -> Array:
        """Return the times, n, s.

        Raises:
            ConfigError: If they do not rise, or are not plausible as seconds.
        """
        times_s: Array = self._values[:, self.names.index(TIME)]
        title = self.title(TIME)
        for row in (np.flatnonzero(~(np.diff(times_s) > 0.0)) + 1)[:1].tolist():
            raise ConfigError(
                f"{self._at(row)}, column {title!r}: time does not increase, {times_s[row]:.12g} after "
                f"{times_s[row - 1]:.12g} s; {self._remedy_of_order(times_s, row)}"
            )
        period_s = float(np.median(np.diff(times_s))) if len(times_s) > 2 else MAX_PERIOD_S
        if not MIN_PERIOD_S <= period_s <= MAX_PERIOD_S:
            raise ConfigError(
                f"{self._path}, column {title!r}: samples are {period_s:.6g} s apart, plausible are "
                f"{MIN_PERIOD_S:g} to {MAX_PERIOD_S:g} s; {self._remedy_of_times(period_s)}"
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
        raw = times_s[row - 1 : row + 1] / float(self._sizes[self.names.index(TIME)])
        bits = counter_bits(float(raw[0]), float(raw[1]))
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
        spacing = period_s / float(self._sizes[self.names.index(TIME)])
        sizes = {} if self._units.get(TIME) == ISO else TIMES_S
        units = [
            f"{TIME}={self.title(TIME)}/{unit} ({spacing * size:.4g} s apart)"
            for unit, size in sizes.items()
            if MIN_PERIOD_S <= spacing * size <= MAX_PERIOD_S
        ]
        if sizes and 1.0 <= spacing < MAX_STEP_FRAMES:
            units.append(f"{TIME}={self.title(TIME)}/0.01 for numbers of frames at 100 Hz")
        return f"set columns to its unit: {' or '.join(units)}" if units else "record at another rate"

    def vectors(self, body: str, names: Sequence[str]) -> Array:
        """Return columns side by side, n x k, SI, z up. Rows in which the body is lost are NaN, and noted.

        Raises:
            ConfigError: If all are 0 in a row, which stands for "lost" in many programs.
        """
        vectors = self._values[:, [self.names.index(name) for name in names]]
        columns = f"{self.title(names[0])!r} to {self.title(names[-1])!r}"
        marks = parse_number(self._form.lost, " ") * self._sizes[[self.names.index(name) for name in names]]
        is_lost_row = ~np.isfinite(vectors).all(axis=1) | (vectors == marks).all(axis=1)
        zeros = np.flatnonzero((vectors == 0.0).all(axis=1) & ~is_lost_row)
        if len(zeros) and not self._form.lost:
            raise ConfigError(
                f"{self._at(int(zeros[0]))}, columns {columns}: are all 0; set lost to 0 if the "
                f"{body} is lost there, or to nan if it is not"
            )
        if is_lost_row.any():
            self.notes.append(f"{body} ({columns}): missing in {self._rows_text(is_lost_row)}; left out")
        up = UP_AXES[self._form.up]
        turned: Array = vectors.copy()
        if self._form.up != "z" and len(names) > 2:
            turn = functools.partial(multiply if len(names) == 4 else rotate, up)
            turned = np.array([turn(each) for each in vectors.tolist()])
        turned[is_lost_row] = np.nan
        return turned

    def check_positions(self, body: str, names: Sequence[str], positions: Array, times_s: Array) -> None:
        """Check that `positions` of a body, n x k, NaN where it is lost, are plausible as metres, z up.

        Raises:
            ConfigError: If they are not.
        """
        where = f"columns {self.title(names[0])!r} to {self.title(names[-1])!r}"
        if problem := _find_implausible(body, positions, times_s):
            row, clause = problem
            at = f"{self._path}" if row is None else self._at(row)
            remedies = self._remedies_of_positions(body, names, positions, times_s)
            if row is not None:
                remedies.append("lost to the number that stands for lost bodies")
            raise ConfigError(f"{at}, {where}: the {body} {clause}; set {', or '.join(remedies)}")

    def _remedies_of_positions(
        self, body: str, names: Sequence[str], positions: Array, times_s: Array
    ) -> list[str]:
        """Return the declarations of unit and axis with which `positions` are plausible."""
        own = self._sizes[self.names.index(names[0])]
        units = {
            unit: float(np.nanmedian(np.linalg.norm(positions, axis=1))) * size / own
            for unit, size in LENGTHS_M.items()
            if not _find_implausible(body, positions * (size / own), times_s)
        }
        remedies: list[str] = []
        if units:
            example = ",".join(f"{name}={self.title(name)}/{next(iter(units))}" for name in names)
            fitting = join_names([f"{unit} ({away_m:.3g} m away)" for unit, away_m in units.items()])
            remedies.append(f"columns to their unit, such as {example}, plausible are {fitting}")
        if len(names) > 2:
            in_file = positions @ _matrix(inverse(UP_AXES[self._form.up]))
            axes = [
                up
                for up, turn in UP_AXES.items()
                if not _find_implausible(body, in_file @ _matrix(turn), times_s)
            ]
            remedies += [f"up to the axis that points up, {join_names(axes)}"] * bool(axes)
            both = [
                f"{unit} with up {up}"
                for unit, size in LENGTHS_M.items()
                for up, turn in UP_AXES.items()
                if body == "head"
                and size != own
                and up != self._form.up
                and not _find_implausible(body, in_file @ _matrix(turn) * (size / own), times_s)
            ]
            remedies += [f"both, plausible are {join_names(both)}"] * bool(both)
        return remedies or [f"columns to those of the {body}"]

    def _rows_text(self, is_row: Mask) -> str:
        """Return the number of rows, gaps and the first line of the rows `is_row`."""
        times_s = self._values[:, self.names.index(TIME)]
        ends = np.flatnonzero(np.diff(is_row.astype(int), prepend=0, append=0)).reshape(-1, 2)
        longest_s = max(
            times_s[min(end, len(times_s) - 1)] - times_s[max(begin - 1, 0)] for begin, end in ends
        )
        gaps = f"{len(ends)} gap{'' if len(ends) == 1 else 's'} of up to {longest_s:.2f} s"
        return (
            f"{is_row.sum()} of {len(is_row)} rows, {gaps}, the first in line {self.lines[int(ends[0][0])]}"
        )


def _matrix(turn: Quaternion) -> Array:
    """Return the matrix by which rows of vectors are multiplied to be turned by `turn`."""
    return np.array([rotate(turn, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))])


def _find_implausible(body: str, positions: Array, times_s: Array) -> tuple[int | None, str] | None:
    """Return the row and a clause about implausible `positions` of a body, n x k, m, z up.

    The row is None if the clause is about all, and the result None if they are plausible.
    """
    distances = np.linalg.norm(positions, axis=1)
    if body == "points":  # rays near the horizon meet the floor far away
        distances = np.where(np.isfinite(distances), np.nanmedian(distances), np.nan)
    for row in np.flatnonzero(distances > MAX_DISTANCE_M)[:1].tolist():
        return row, f"is {distances[row]:.6g} m away, limit {MAX_DISTANCE_M:g} m"
    known = np.flatnonzero(np.isfinite(distances))
    if body == "points" or len(known) < 3:
        return None
    height_m = float(np.median(positions[known, 2]))
    if body == "head" and not HEAD_RANGE_M[0] <= height_m <= HEAD_RANGE_M[1]:
        limits = f"{HEAD_RANGE_M[0]:g} to {HEAD_RANGE_M[1]:g} m"
        return None, f"is {height_m:.6g} m above the floor, plausible are {limits}"
    if (lowest_m := float(positions[known, 2].min())) < -MAX_BELOW_FLOOR_M:
        return None, f"is {-lowest_m:.6g} m below the floor, limit {MAX_BELOW_FLOOR_M:g} m"
    steps = np.linalg.norm(np.diff(positions[known], axis=0), axis=1) / np.diff(times_s[known])
    if (speed_mps := float(np.percentile(steps, 90))) > MAX_SPEED_MPS:
        return None, f"moves at {speed_mps:.6g} m/s, limit {MAX_SPEED_MPS:g} m/s"
    return None


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
    lines = list(check_lengths(_read_text(path).splitlines(), f"{path}: "))
    names = header_names(lines[:MAX_HEADER_LINES]) if "/" in form.columns else frozenset[str]()
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
    known = {*required, *itertools.chain(*optional)}
    groups = [group for group in (required, *optional) if group is required or declared.keys() & {*group}]
    wanted: dict[str, str | int] = {name: name for group in groups for name in group}
    wanted |= {name: each.source for name, each in declared.items() if name in known}
    is_date = TIME in declared and declared[TIME].unit == ISO
    layout = find_layout(
        lines[:MAX_HEADER_LINES],
        wanted,
        optional=sorted(known - wanted.keys()),
        anchors=required[1:2] if is_date else (TIME,),
        texts=(TIME,) if is_date else (),
        remedy=_remedy(required),
    )
    for group in optional:
        missing = {*group} - layout.indices.keys()
        if 0 < len(missing) < len(group):
            raise ConfigError(f"there is no column {join_names(sorted(missing))}; {_remedy(group)}")
    return layout


def _remedy(required: Sequence[str]) -> str:
    numbered = ",".join(f"{name}={at}" for at, name in enumerate(required, start=1))
    angles = ", and quaternions, as angles are not read" if "qx" in required else ""
    return (
        f"set columns to those of the file by name or number, such as {numbered}, with their units, such "
        f"as t=1/ms or t=1/iso for dates{angles}"
    )


def _read_text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ConfigError(
                f"{path}: has {round_beyond(size / 1e6, MAX_BYTES / 1e6)} MB and at most "
                f"{MAX_BYTES / 1e6:.0f} MB are read; cut it into pieces"
            )
        text = path.read_text("utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
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
    return (time if time.tzinfo else time.replace(tzinfo=dt.UTC)).timestamp()


def _with_channels(path: Path, lines: Sequence[str]) -> tuple[list[str], list[dict[str, str]]]:
    """Return the lines of a `_motion.tsv` below the names of its channels, and the rows of `_channels.tsv`.

    Without a channel of times, rows have those of the sampling frequency in `_motion.json`.
    """
    beside = path.with_name(path.name.removesuffix(BIDS_SUFFIX) + CHANNELS_SUFFIX)
    channels = list(csv.DictReader(_read_text(beside).splitlines(), delimiter="\t", restval=""))
    if missing := [
        name for name in ("name", "component", "type", "units") if name not in (channels or [{}])[0]
    ]:
        raise ConfigError(f"{beside}: has no column {join_names(missing)}; correct it as Motion-BIDS says")
    if all(each["type"] != "LATENCY" for each in channels):
        sidecar = path.with_suffix(".json")
        try:
            rate_hz = float(json.loads(_read_text(sidecar))["SamplingFrequency"])
            lines = [f"{line}\t{row / rate_hz:.9f}" for row, line in enumerate(lines)]
        except (ValueError, TypeError, KeyError, ArithmeticError):
            raise ConfigError(
                f"{sidecar}: has no SamplingFrequency above 0, and {beside.name} no LATENCY; add one"
            ) from None
        channels.append({"name": TIME, "component": "n/a", "type": "LATENCY", "units": "s"})
    return ["\t".join(each["name"] for each in channels), *lines], channels


def _declare_channels(
    channels: Sequence[Mapping[str, str]], declared: Mapping[str, DeclaredColumn]
) -> dict[str, DeclaredColumn]:
    """Return `declared`, and the channels of time and orientation, with the units of `channels`.

    Raises:
        ConfigError: If the unit of one is unknown.
    """
    kinds = {TIME: ("LATENCY", "n/a")} | {name: ("ORNT", f"quat_{name[1]}") for name in ORIENTATION}
    columns = dict(declared)
    for ours, kind in kinds.items():
        names = [each["name"] for each in channels if (each["type"], each["component"].lower()) == kind]
        if len(names) == 1:
            columns.setdefault(ours, DeclaredColumn(names[0]))
    units = {each["name"]: each["units"] for each in channels}
    for ours, column in columns.items():
        unit = units.get(str(column.source), "n/a")
        if column.unit or unit == "n/a" or not MOTION_COLUMNS[ours]:
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
    for row in np.flatnonzero(np.isfinite(vectors).all(axis=1)).tolist():
        yield row, vectors[row].tolist()
