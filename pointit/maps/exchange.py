"""Exchange of maps with other LED programs: WLED's segments and ledmap, and pixels as CSV (x, y, z)."""

import csv
import io
import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit.maps.light_files.pixel_table import NO_COLUMNS, TablePixel, pixels_of
from pointit.maps.light_files.strip_fit import (
    FittedStrip,
    Note,
    check_steps,
    first_pixels,
    fit_strips,
    free_name,
    median_step,
    named_strips,
    no_note,
    pixels_along,
    strip_entry,
)
from pointit.maps.light_files.wled import GAP, MAX_CELLS, WledSegment, read_ledmap, read_segments
from pointit.maps.model import MapFile, StripEntry
from pointit.maps.text_table import DeclaredColumn
from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError
from pointit.schemas.table_types import valid_name

LONE_PIXEL_M = 0.02
"""Length of a strip of one pixel in a file without any step from pixel to pixel, m."""
BESIDE_CELLS = 1.5
"""Longest step to a cell of a grid that is beside or diagonally beside, in cells."""
VIEWS = {"top": (0, 1), "front": (0, 2), "side": (1, 2)}
"""Axes that become columns and rows of a ledmap."""


def positions(strip: StripEntry) -> Array:
    """Return the positions of a strip's pixels in the order of its wire, n x 3, m."""
    points = pixels_along(np.array(strip.line), strip.pixels)
    return points if strip.direction == 1 else points[::-1]


def to_csv(file: MapFile) -> str:
    """Return all pixels as CSV with the columns x, y, z, strip, pixel: m, in the order of the map.

    xLights and most other programs read the first three columns, one line for each pixel. If a strip has an
    offset, the column wire has the number of each pixel on the wire.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    has_offsets = any(strip.offset is not None for strip in file.strips.values())
    header = ["x", "y", "z", "strip", "pixel"]
    if has_offsets:
        header.append("wire")
    writer.writerow(header)
    firsts = first_pixels(file.strips)
    for name, strip in file.strips.items():
        for pixel, point in enumerate(positions(strip)):
            row: list[object] = [f"{value:.5f}" for value in point]
            row += (name, pixel)
            if has_offsets:
                row.append(firsts[name] + pixel)
            writer.writerow(row)
    return text.getvalue()


def from_csv(
    text: str,
    on_note: Note = no_note,
    columns: Mapping[str, DeclaredColumn] = NO_COLUMNS,
    first: int | None = None,
    gap_m: float | None = None,
) -> dict[str, StripEntry]:
    """Return the strips of a CSV with one pixel a line.

    Columns are x, y, z, m, perhaps strip, and pixel or wire: the number on the strip or on the wire.
    `columns` declares others. A strip ends where a number is skipped, or the next pixel is beyond `gap_m`.
    `on_note` receives a sentence on columns without use, and on each name that no map can have and
    that is replaced.

    Args:
        text: content of the file.
        on_note: receives notes.
        columns: declared columns, by our names.
        first: number of the first pixel of a strip, or of the wire, 0 or 1. None if it is not declared.
        gap_m: longest step within a strip, m. None if it is not declared.

    Raises:
        ConfigError: If a line is not such, there are too many, the numbers may be others, or a step without
            a name of the strip is too long. Names the line, or the parameter that describes it.
    """
    pixels, is_of_wire, unused = pixels_of(text, columns)
    if unused:
        on_note(f"columns {join_names(unused)} are not used")
    groups: dict[str, list[TablePixel]] = {}
    for pixel in pixels:
        groups.setdefault(pixel.strip, []).append(pixel)
    if not groups:
        raise ConfigError("there are no pixels: write one a line, as x,y,z in metres")

    # What the numbers mean is checked before any strip is made of them
    numbers_given = [pixel.number for pixel in pixels if pixel.number is not None]
    min_number = min(numbers_given, default=first or 0)
    _check_first(min_number, first, is_declared=not is_of_wire or "wire" in columns)
    if not (is_of_wire or "pixel" in columns):
        _check_numbers_of_strips(groups, first or 0)

    # Numbers of each strip become those of one wire, on which the strips follow one another
    strips: list[tuple[str, int, FittedStrip]] = []
    usual_m = _usual_step(groups.values())
    end = 0
    for name, group in groups.items():
        numbers, points = _in_order(name, group, first or 0)
        if not is_of_wire:
            numbers += end
            end = int(numbers[-1]) + 1

        # A long step may be a gap between strips, unless a name or `gap_m` says otherwise
        if gap_m is None and not name:
            starts = np.flatnonzero(np.diff(numbers) != 1) + 1
            for run in np.split(points, starts):
                check_steps(run)
        for strip in fit_strips(points, numbers, usual_m, gap_m or math.inf):
            strips.append((name, int(numbers[strip.first]), strip))
    return named_strips(strips, {*groups}, on_note)


def _check_first(lowest: int, first: int | None, *, is_declared: bool) -> None:
    """Check that `lowest`, the lowest number of a pixel, 0 if they have none, agrees with `first`.

    Raises:
        ConfigError: If it does not.
    """
    if first is None and lowest == 1 and is_declared:
        raise ConfigError("no pixel has the number 0; set first to 1 if they are numbered from 1, else to 0")
    if first and lowest < first:
        raise ConfigError(f"a pixel has the number {lowest}; set first to 0")


def _check_numbers_of_strips(groups: Mapping[str, Sequence[TablePixel]], first: int) -> None:
    """Check that the numbers of pixels are those of each strip, not of the wire.

    Raises:
        ConfigError: If no two strips share one, or one begins behind the number of its pixels.
    """
    if len(groups) < 2:
        return
    numbers_of: dict[str, set[int]] = {}
    for name, group in groups.items():
        numbers_of[name] = {pixel.number for pixel in group if pixel.number is not None}
    distinct = {*itertools.chain.from_iterable(numbers_of.values())}
    are_shared = sum(map(len, numbers_of.values())) > len(distinct)
    for name, numbers in numbers_of.items():
        if not numbers:
            continue
        begins_behind = min(numbers) - first >= len(numbers)
        if begins_behind or not are_shared:
            strip = name or "without a name"
            raise ConfigError(
                f"pixels of strip {strip} have the numbers {min(numbers)} to {max(numbers)}; "
                "set columns to wire=pixel if they are those of the wire, or to pixel=pixel if of each strip"
            )


def _in_order(name: str, group: Sequence[TablePixel], base: int) -> tuple[NDArray[np.intp], Array]:
    """Return the numbers of a strip's pixels from 0, ascending, and their positions."""
    lines: dict[int, TablePixel] = {}
    for index, pixel in enumerate(group):
        number = index if pixel.number is None else pixel.number - base
        other = lines.setdefault(number, pixel)
        if other is not pixel:
            strip = f"of {name} " if name else ""
            raise ConfigError(
                f"line {pixel.line}: pixel {pixel.number} {strip}is in line {other.line}, too; "
                "correct one of them"
            )
    numbers = sorted(lines)
    points = [lines[number].point for number in numbers]
    return np.array(numbers, dtype=np.intp), np.array(points)


def _usual_step(groups: Iterable[Sequence[TablePixel]]) -> float:
    """Return the length of a pixel, m."""
    points_of: list[Array] = []
    for group in groups:
        points_of.append(np.array([pixel.point for pixel in group]))
    distinct = np.unique(np.concatenate(points_of), axis=0)
    if len(distinct) < 2:
        raise ConfigError(
            f"all pixels are at {points_of[0][0].tolist()}; correct their positions, "
            "or write a single one into a map as a lamp"
        )
    steps = [np.linalg.norm(np.diff(points, axis=0), axis=1) for points in points_of]
    return median_step(np.concatenate(steps)) or LONE_PIXEL_M


def to_segments(file: MapFile) -> str:
    """Return the strips as WLED segments, JSON for its /json/state: one wire, in the order of the map."""
    firsts = first_pixels(file.strips)
    segments: list[dict[str, object]] = []
    for number, (name, strip) in enumerate(file.strips.items()):
        start = firsts[name]
        stop = start + strip.pixels
        segments.append({"id": number, "n": name, "start": start, "stop": stop, "rev": False})
    return json.dumps({"seg": segments})


def from_segments(text: str, preset: int | None = None, on_note: Note = no_note) -> dict[str, WledSegment]:
    """Return the segments of WLED by name: of a state, a preset, or the configured outputs.

    What a map's names cannot have becomes `_`, which `on_note` receives as a sentence, and a second segment
    of a name gets a number.

    Raises:
        ConfigError: If it is not such.
    """
    segments: dict[str, WledSegment] = {}
    for segment in read_segments(text, preset):
        plain = valid_name(segment.name)
        name = free_name(plain or f"segment_{segment.number}", segments)
        if plain != segment.name:
            on_note(f"segment {format_value(segment.name)} is called {name}, a name that a map can have")
        segments[name] = segment
    return segments


def laid_out(segments: Mapping[str, WledSegment], pitch_m: float) -> dict[str, StripEntry]:
    """Return strips of `segments` one above the other, to be moved to where they are."""
    strips: dict[str, StripEntry] = {}
    end = 0
    for row, (name, segment) in enumerate(segments.items()):
        length_m = round(segment.pixels * pitch_m, 4)
        height_m = round(0.1 * row, 1)
        line = [[0.0, 0.0, height_m], [length_m, 0.0, height_m]]

        # Without an offset, it goes on where the one before ends
        start = end if segment.start is None else segment.start
        offset = None if start == end else start
        strips[name] = strip_entry(line, segment.pixels, offset)
        end = start + segment.pixels
    return strips


def to_ledmap(file: MapFile, view: str, cell_m: float) -> str:
    """Return the strips as WLED's ledmap.json: a grid of cells seen from the top, front or side.

    Each cell has the number of its pixel, -1 if there is none. Two pixels in one cell: the first counts.

    Raises:
        ConfigError: If the grid would be too large, or there are no strips.
    """
    if not file.strips:
        raise ConfigError("the map has no strips")

    # Position and number on the wire of each pixel
    firsts = first_pixels(file.strips)
    points_m = np.concatenate([positions(strip) for strip in file.strips.values()])
    numbers: list[int] = []
    for name, strip in file.strips.items():
        numbers += range(firsts[name], firsts[name] + strip.pixels)

    # Its cell, from the lower left corner on
    view_m = points_m[:, VIEWS[view]]
    offsets_m = view_m - view_m.min(axis=0)
    cells = np.floor(offsets_m / cell_m + 0.5).astype(np.intp)
    last_column, last_row = cells.max(axis=0).tolist()
    width = last_column + 1
    height = last_row + 1
    if width * height > MAX_CELLS:
        raise ConfigError(f"{width} x {height} cells are too many; write a larger --cell")

    # Rows of a ledmap begin at the top. Backwards, so that the first pixel of a cell is written last.
    grid = np.full((height, width), GAP)
    rows = height - 1 - cells[::-1, 1]
    columns = cells[::-1, 0]
    grid[rows, columns] = numbers[::-1]
    ledmap = {"n": view, "width": width, "height": height, "map": grid.ravel().tolist()}
    return json.dumps(ledmap, separators=(",", ":"))


def from_ledmap(text: str, cell_m: float, gap_m: float | None = None) -> dict[str, StripEntry]:
    """Return the strips of a WLED ledmap with width and height, on an upright plane, `cell_m` a cell.

    A strip ends where a number is skipped, or the next pixel is beyond `gap_m`, m: None means in no cell
    beside or diagonally beside.

    Raises:
        ConfigError: If it is not such.
    """
    cells, height = read_ledmap(text)
    numbers = np.array([number for number, _, _ in cells], dtype=np.intp)
    places = [[column, 0.0, height - 1 - row] for _, column, row in cells]  # rows begin at the top
    points = cell_m * np.array(places, dtype=np.float64)
    fitted = fit_strips(points, numbers, cell_m, gap_m or BESIDE_CELLS * cell_m)
    strips = [("", int(numbers[strip.first]), strip) for strip in fitted]
    return named_strips(strips, ())


def strips_text(strips: Mapping[str, StripEntry]) -> str:
    """Return the text of a map of `strips`.

    If numbers of the wire are skipped, it ends with the segments that an output needs, as a comment.
    """
    lines = ["strips:"]
    for name, strip in strips.items():
        lines += [
            f"  {json.dumps(name)}:",
            f"    line: {[list(point) for point in strip.line]}",
            f"    pixels: {strip.pixels}",
        ]
        if strip.offset is not None:
            lines.append(f"    offset: {strip.offset}")
    if any(strip.offset is not None for strip in strips.values()):
        lines += ["# Numbers of the wire are skipped: describe its output by", "# segments:"]
        for name, first in first_pixels(strips).items():
            lines.append(f"#   - {{strip: {json.dumps(name)}, offset: {first}}}")
    return "\n".join([*lines, ""])
