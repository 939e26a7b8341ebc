"""Content of a PLY file: its header, and the columns x, y and z of its vertices (text or binary)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError

MAX_HEADER_LINES = 1000
"""Limit of the lines of a header. A longer one is not a PLY."""

AXES = ("x", "y", "z")

_TYPES = {
    code: kind
    for kind, names in {
        "i1": ("char", "int8"),
        "u1": ("uchar", "uint8"),
        "i2": ("short", "int16"),
        "u2": ("ushort", "uint16"),
        "i4": ("int", "int32"),
        "u4": ("uint", "uint32"),
        "f4": ("float", "float32"),
        "f8": ("double", "float64"),
    }.items()
    for code in names
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True, kw_only=True)
class Element:
    """One of the tables of a PLY."""

    name: str
    rows: int
    properties: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    """Name and numpy's type, `""` for a list."""

    def row(self, order: str) -> np.dtype[np.void]:
        """Return the layout of a row in the file, with fields f0, f1, … as a PLY may have a name twice."""
        return np.dtype([(f"f{at}", order + kind) for at, (_, kind) in enumerate(self.properties)])


@dataclass(frozen=True, kw_only=True)
class PlyHeader:
    """Header of a PLY."""

    order: str
    """Byte order, `<` or `>`. `""` if the body is text."""
    body: int
    """Offset of the body, bytes."""
    before: list[Element]
    """Tables of the body before the vertices."""
    vertex: Element

    @property
    def columns(self) -> list[int]:
        """Return the indices of x, y and z among the properties of a vertex."""
        names = [name for name, _ in self.vertex.properties]
        return [names.index(axis) for axis in AXES]


def read_ply_header(path: Path) -> PlyHeader:
    """Return the header of the PLY at `path`.

    Raises:
        ConfigError: If it is not a PLY, or lists precede the vertices.
        OSError: If it cannot be read.
    """
    with path.open("rb") as file:
        order, elements = _read_lines(path, file)
        body = file.tell()
    place = next((at for at, each in enumerate(elements) if each.name == "vertex"), None)
    if place is None:
        raise ConfigError(f"{path}: has no element vertex; give a PLY with points")
    header = PlyHeader(order=order, body=body, before=elements[:place], vertex=elements[place])
    names = [name for name, _ in header.vertex.properties]
    if missing := [axis for axis in AXES if names.count(axis) != 1]:
        raise ConfigError(
            f"{path}: its vertices have {join_names(names) or 'nothing'}, not {join_names(missing)} once; "
            "export it with x, y and z"
        )
    _check_lists(path, header)
    return header


def binary_vertices(path: Path, header: PlyHeader) -> NDArray[np.float64]:
    """Return x, y, z of the vertices, n x 3. Fewer than in the header if the file is cut off.

    Raises:
        OSError: If it cannot be read.
    """
    offset = header.body + sum(each.row(header.order).itemsize * each.rows for each in header.before)
    row = header.vertex.row(header.order)
    there = max(0, path.stat().st_size - offset) // row.itemsize
    if not there:  # a header may claim more than the file has
        return np.zeros((0, 3))
    rows = np.fromfile(path, dtype=row, count=min(there, header.vertex.rows), offset=offset)
    with np.errstate(invalid="ignore"):  # a signalling NaN, rejected later like other NaNs
        return np.column_stack([rows[f"f{column}"].astype(np.float64) for column in header.columns])


def _read_lines(path: Path, file: BinaryIO) -> tuple[str, list[Element]]:
    """Return order and elements. Afterwards `file` is at the body."""
    if file.readline(80).strip() != b"ply":
        raise ConfigError(
            f"{path}: does not begin with `ply`; give a PLY file, or rename it to .xyz if it is plain text"
        )
    order: str | None = None
    elements: list[Element] = []
    for number in range(2, MAX_HEADER_LINES + 2):
        line = file.readline(4096)
        words = line.decode("ascii", errors="replace").split()
        if not line:
            break
        if words == ["end_header"] and order is not None:
            return order, elements
        try:
            if words[:1] == ["format"]:
                order = _order(words)
            else:
                _parse_line(words, elements)
        except (KeyError, IndexError, ValueError):
            raise ConfigError(
                f"{path}: line {number} of its header is not understood, {format_value(' '.join(words))}; "
                "export it as PLY 1.0 again"
            ) from None
    raise ConfigError(f"{path}: its header does not end; it is cut off or not a PLY, copy or export it again")


def _order(words: Sequence[str]) -> str:
    _, name, version = words
    if version != "1.0":
        raise ValueError
    return _ORDERS[name]


def _parse_line(words: Sequence[str], elements: list[Element]) -> None:
    match words:
        case [] | ["comment" | "obj_info", *_]:
            pass
        case ["element", name, count]:
            elements.append(Element(name=name, rows=_count(count)))
        case ["property", "list", _, _, name]:
            elements[-1].properties.append((name, ""))
        case ["property", kind, name]:
            elements[-1].properties.append((name, _TYPES[kind]))
        case _:
            raise ValueError


def _count(text: str) -> int:
    count = int(text)
    if count < 0:
        raise ValueError
    return count


def _check_lists(path: Path, header: PlyHeader) -> None:
    """Check that no lists hide the position of the points: anywhere in binary, before them in text."""
    if header.order:
        inside = [(each.name, each.properties) for each in (*header.before, header.vertex)]
    else:
        inside = [("vertex", header.vertex.properties[: max(header.columns)])]
    for element, properties in inside:
        for name, kind in properties:
            if not kind:
                raise ConfigError(
                    f"{path}: element {element} has the list {name}, which hides where the points are; "
                    "export it with the vertices first and without lists in them"
                )
