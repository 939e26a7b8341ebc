"""Headers and vertices of PLY and PCD files, text or binary."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from pointit.maps.text_table import Wanted, column_indices, shown_cells
from pointit.runtime.config.validation_message import format_value
from pointit.runtime.errors import ConfigError

MAX_HEADER_LINES = 1000
"""Limit of the lines of a header. A longer one is not a PLY."""

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
        "i8": ("int64",),
        "u8": ("uint64",),
        "f8": ("double", "float64"),
    }.items()
    for code in names
}
_MAX_LINE = 4096
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read_pcd_header(sample: Sequence[str]) -> tuple[int, list[str]] | None:
    """Return the number of lines before the points and the names of the columns, None if it is no PCD.

    Args:
        sample: first lines of the file.

    Raises:
        ConfigError: If the points are binary, or the header is not understood. Does not name the file.
    """
    lines: dict[str, list[str]] = {}
    for number, line in enumerate(sample, start=1):
        word, *values = line.split() or [""]
        lines[word.upper()] = values
        if word.upper() != "DATA" or not {"FIELDS", "COLUMNS"} & lines.keys():
            continue

        # The last line of the header: points as text, and columns of each field
        if [value.lower() for value in values] != ["ascii"]:
            raise ConfigError(
                f"is a PCD with the points {format_value(' '.join(values))}; save it with ascii points, as "
                "`pcl_convert_pcd_ascii_binary FILE OUT 0` does, or as PLY"
            )
        fields = lines.get("FIELDS") or lines.get("COLUMNS") or []
        counts = lines.get("COUNT") or ["1"] * len(fields)
        if len(counts) != len(fields) or not all(map(str.isdecimal, counts)):
            raise ConfigError(
                f"is a PCD with {len(fields)} FIELDS and COUNT {format_value(' '.join(counts))}; "
                "export it again"
            )
        names: list[str] = []
        for name, count in zip(fields, counts, strict=True):
            names += [name] * int(count)
        return number, names
    return None


@dataclass(frozen=True, kw_only=True)
class Property:
    """A column of an element."""

    name: str
    kind: str
    """Type of numpy, of a list that of its values."""
    count_kind: str = ""
    """Type of the number of values of a list, `""` if it is none."""


@dataclass(frozen=True, kw_only=True)
class Element:
    """One of the tables of a PLY."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list[Property])

    @property
    def has_list(self) -> bool:
        """Return True if its rows may differ in size."""
        return any(column.count_kind for column in self.properties)


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
    columns: list[int]
    """Indices of x, y and z among the properties of a vertex."""

    @property
    def is_list_before_points(self) -> bool:
        """Return True if a vertex has a list before one of x, y and z."""
        columns_before = self.vertex.properties[: max(self.columns)]
        return any(column.count_kind for column in columns_before)


def read_ply_header(path: Path, wanted: Wanted, remedy: str) -> PlyHeader:
    """Return the header of the PLY at `path`.

    Args:
        path: file.
        wanted: properties of a vertex that are x, y and z.
        remedy: declaration of others, the end of a sentence.

    Raises:
        ConfigError: If it is not a PLY, or its vertices lack one of them.
        OSError: If it cannot be read.
    """
    with path.open("rb") as file:
        order, elements = _read_lines(path, file)
        body = file.tell()
    element_names = [element.name for element in elements]
    if "vertex" not in element_names:
        raise ConfigError(f"{path}: has no element vertex; give a PLY with points")
    index = element_names.index("vertex")

    # x, y and z of its vertices are numbers
    vertex = elements[index]
    names = [column.name for column in vertex.properties]
    indices = column_indices(wanted, names)
    if indices is None:
        raise ConfigError(f"{path}: its vertices have {shown_cells(names)}; {remedy}")
    columns = [indices[axis] for axis in ("x", "y", "z")]
    for column in columns:
        if vertex.properties[column].count_kind:
            raise ConfigError(f"{path}: {names[column]} is a list; export it with a number x, y and z each")
    return PlyHeader(order=order, body=body, before=elements[:index], vertex=vertex, columns=columns)


def _read_lines(path: Path, file: BinaryIO) -> tuple[str, list[Element]]:
    """Return order and elements. Afterwards `file` is at the body."""
    if file.readline(_MAX_LINE).strip() != b"ply":
        raise ConfigError(
            f"{path}: does not begin with the line `ply`; give a PLY file, or rename plain text to .xyz"
        )
    order: str | None = None
    elements: list[Element] = []
    for number in range(2, MAX_HEADER_LINES + 2):
        line = file.readline(_MAX_LINE)
        words = line.decode(errors="replace").split()
        if not line:
            break
        if words == ["end_header"] and order is not None:
            return order, elements

        # Lines that are not understood raise whatever comes of them
        try:
            if words[:1] == ["format"]:
                order = _order(words)
            elif words[:1] not in (["comment"], ["obj_info"]):
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
        case []:
            pass
        case ["element", name, count]:
            elements.append(Element(name=name, rows=_count(count)))
        case ["property", "list", count_kind, kind, name]:
            list_property = Property(name=name, kind=_TYPES[kind], count_kind=_TYPES[count_kind])
            elements[-1].properties.append(list_property)
        case ["property", kind, name]:
            elements[-1].properties.append(Property(name=name, kind=_TYPES[kind]))
        case _:
            raise ValueError


def _count(text: str) -> int:
    count = int(text)
    if count < 0:
        raise ValueError
    return count


def binary_vertices(path: Path, header: PlyHeader) -> NDArray[np.float64]:
    """Return x, y, z of the vertices, n x 3. Fewer than in the header if the file is cut off.

    Raises:
        OSError: If it cannot be read.
    """
    # Rows with lists differ in size, so that the whole file must be read
    has_lists = any(element.has_list and element.rows for element in (*header.before, header.vertex))
    data = np.fromfile(path, dtype=np.uint8) if has_lists else np.zeros(0, dtype=np.uint8)
    offset = header.body
    for element in header.before:
        offset = _end_of(data, offset, element, header.order)
    if not header.vertex.has_list:
        row = _row_type(header.vertex, header.order)
        rows = max(0, path.stat().st_size - offset) // row.itemsize
        if not rows:  # a header may claim more than the file has
            return np.zeros((0, 3))
        table = np.fromfile(path, dtype=row, count=min(rows, header.vertex.rows), offset=offset)
        with np.errstate(invalid="ignore"):  # a signalling NaN, rejected later like other NaNs
            coordinates = [table[f"f{column}"].astype(np.float64) for column in header.columns]
        return np.column_stack(coordinates)

    # Vertices with lists, one by one
    offsets = list(_rows_of(data, offset, header.vertex, header.order, header.columns))
    starts = np.array(offsets, dtype=np.int64).reshape(-1, 3)
    kinds = [header.order + header.vertex.properties[column].kind for column in header.columns]
    with np.errstate(invalid="ignore"):
        coordinates = [_values_at(data, starts[:, axis], kind) for axis, kind in enumerate(kinds)]
    return np.column_stack(coordinates)


def ascii_vertex_lines(lines: Iterable[str], header: PlyHeader) -> Iterator[str]:
    """Yield x, y and z of each vertex of a text whose vertices have lists before them, a line each."""
    columns = header.vertex.properties[: max(header.columns) + 1]
    for line in lines:
        words = line.split()
        if not words:
            continue

        # Index of the first word of each column. A list begins with the number of its values; one that is no
        # number leaves no words for the others.
        starts: list[int] = []
        index = 0
        for column in columns:
            starts.append(index)
            if column.count_kind and index < len(words):
                count = words[index]
                index += int(count) if count.isdecimal() else len(words)
            index += 1
        coordinates: list[str] = []
        for column_index in header.columns:
            if starts[column_index] < len(words):
                coordinates.append(words[starts[column_index]])
        yield " ".join(coordinates)


def _row_type(element: Element, order: str) -> np.dtype[np.void]:
    """Return the layout of a row without lists, with fields f0, f1, … as a PLY may have a name twice."""
    fields = [(f"f{index}", order + column.kind) for index, column in enumerate(element.properties)]
    return np.dtype(fields)


def _end_of(data: NDArray[np.uint8], offset: int, element: Element, order: str) -> int:
    """Return the offset behind the rows of `element`, which begin at `offset`."""
    if not element.has_list:
        return offset + _row_type(element, order).itemsize * element.rows
    if not element.rows:
        return offset
    for (end,) in _rows_of(data, offset, element, order, [len(element.properties)]):
        offset = end
    return offset


def _rows_of(
    data: NDArray[np.uint8], offset: int, element: Element, order: str, columns: Sequence[int]
) -> Iterator[list[int]]:
    """Yield the offsets of the properties `columns` of each row of `element`, until a row is not whole.

    The offset of the property behind the last one is the end of the row.
    """
    # Sizes of the values and of the counts, 0 if a property is no list
    content = data.tobytes()
    byte_order: Literal["little", "big"] = "little" if order == "<" else "big"
    sizes: list[tuple[int, int]] = []
    for column in element.properties:
        count_size = np.dtype(column.count_kind).itemsize if column.count_kind else 0
        sizes.append((np.dtype(column.kind).itemsize, count_size))
    for _ in range(element.rows):
        starts: list[int] = []
        for size, count_size in sizes:
            starts.append(offset)
            if count_size:
                count = int.from_bytes(content[offset : offset + count_size], byte_order)
                offset += count_size + count * size
            else:
                offset += size
        starts.append(offset)
        if offset > len(content):
            return
        yield [starts[column] for column in columns]


def _values_at(data: NDArray[np.uint8], starts: NDArray[np.int64], kind: str) -> NDArray[np.float64]:
    """Return the values of `kind` whose bytes begin at `starts` of `data`."""
    size = np.dtype(kind).itemsize
    value_bytes = data[starts[:, None] + np.arange(size)]
    values: NDArray[np.float64] = value_bytes.view(kind)[:, 0].astype(np.float64)
    return values
