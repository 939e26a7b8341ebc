"""Tables of pixels: CSV of xLights, of programs that map LEDs with cameras, and of spreadsheets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.maps.text_table import (
    COMMENTS,
    MAX_HEADER_LINES,
    DeclaredColumn,
    TextLayout,
    check_lengths,
    find_layout,
    header_names,
    parse_columns,
    parse_number,
    split_cells,
)
from pointit.maps.units import LENGTHS_M, size_of_unit
from pointit.runtime.errors import ConfigError
from pointit.schemas import FARTHEST

MAX_POINTS = 100_000
AXES = ("x", "y", "z")
PIXEL_COLUMNS: dict[str, dict[str, float]] = {
    "x": LENGTHS_M,
    "y": LENGTHS_M,
    "z": LENGTHS_M,
    "strip": {},
    "pixel": {},
    "wire": {},
}
"""Names of columns with their units: a pixel is numbered on its strip, or on the wire."""
NO_COLUMNS: dict[str, DeclaredColumn] = {}
REMEDY = "set columns to those of x, y and z, by name or number, such as x=1,y=2,z=3, or x=1/cm if not metres"


@dataclass(frozen=True, kw_only=True)
class TablePixel:
    """A line of a table."""

    line: int
    """Number of the line, from 1."""
    strip: str
    """Name of its strip, `""` if the table has none."""
    number: int | None
    """Its number on its strip, or on the wire. None if the table has none."""
    point: NDArray[np.float64]
    """Position, m."""


def parse_pixel_columns(text: str, content: str = "") -> dict[str, DeclaredColumn]:
    """Return the columns that `x=Pos X/cm,pixel=Node` declares of the table `content`.

    Raises:
        ConfigError: If it is not such.
    """
    names = frozenset[str]()
    if "/" in text:
        names = header_names(content.splitlines()[:MAX_HEADER_LINES])
    return parse_columns(text, PIXEL_COLUMNS, names)


def pixels_of(
    text: str, declared: Mapping[str, DeclaredColumn]
) -> tuple[list[TablePixel], bool, Sequence[str]]:
    """Return the pixels of a CSV, True if their numbers are of the wire, and unused columns.

    Raises:
        ConfigError: If a line is no pixel, or it does not have the columns x, y and z, or `declared`.
    """
    # Columns: with a declared number no other one is read, which would count otherwise
    lines = list(check_lengths(text.splitlines()))
    wanted: dict[str, str | int] = {name: name for name in AXES}
    for name, column in declared.items():
        wanted[name] = column.source
    optional = [name for name in PIXEL_COLUMNS if name not in wanted]
    if {"pixel", "wire"} & declared.keys():
        optional = [name for name in optional if name == "strip"]
    layout = find_layout(
        lines[:MAX_HEADER_LINES], wanted, optional=optional, anchors=AXES, texts=("strip",), remedy=REMEDY
    )
    factors: list[float] = []
    for axis in AXES:
        unit = declared[axis].unit if axis in declared else ""
        factors.append(size_of_unit(unit or "m", LENGTHS_M))

    # Rows
    pixels: list[TablePixel] = []
    for line, content in enumerate(lines[layout.skip :], start=layout.skip + 1):
        if not content.strip() or content.lstrip().startswith(COMMENTS):
            continue
        if len(pixels) == MAX_POINTS:
            raise ConfigError(f"more than {MAX_POINTS} pixels; split the file")
        cells = split_cells(content, layout.delimiter, layout.width)
        layout.check_row(line, cells)
        pixels.append(_pixel(line, cells, layout, factors))
    used = {*layout.indices.values()}
    unused: list[str] = []
    for index, name in enumerate(layout.names):
        if name and index not in used:
            unused.append(name)
    return pixels, "wire" in layout.indices, unused


def _pixel(line: int, cells: Sequence[str], layout: TextLayout, factors: Sequence[float]) -> TablePixel:
    """Return the pixel in the `cells` of a line. Raises ConfigError if its numbers cannot be used."""

    def value(name: str) -> float:
        return parse_number(cells[layout.indices[name]], layout.delimiter)

    # A number on the wire wins over one on the strip
    point = np.array([value(axis) for axis in AXES]) * factors
    number: float | None = None
    if "wire" in layout.indices:
        number = value("wire")
    elif "pixel" in layout.indices:
        number = value("pixel")

    shown = repr(layout.delimiter.join(cells)[:60])
    if not np.all(np.abs([*point, number or 0.0]) <= FARTHEST):
        raise ConfigError(f"line {line}: {shown} is no pixel; write numbers up to {FARTHEST:g}, m")
    if number is not None and (number < 0 or number != int(number)):
        raise ConfigError(f"line {line}: {shown} has the number {number:g}; write whole numbers from 0")
    strip = cells[layout.indices["strip"]] if "strip" in layout.indices else ""
    return TablePixel(
        line=line,
        strip=strip,
        number=None if number is None else int(number),
        point=point,
    )
