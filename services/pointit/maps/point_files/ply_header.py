"""Header of a PLY file: its elements and their properties."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from pointit.maps.point_files.point_columns import AXES, named_columns
from pointit.maps.point_files.stated_units import StatedUnit
from pointit.runtime.config.validation_message import format_value, join_names
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
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_MAX_LINE = 4096
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


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
        return any(each.count_kind for each in self.properties)


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
    units: Sequence[StatedUnit]
    """Units that the names of these properties state."""
    comments: list[str]

    @property
    def is_list_before_points(self) -> bool:
        """Return True if a vertex has a list before one of x, y and z."""
        return any(each.count_kind for each in self.vertex.properties[: max(self.columns)])


def read_ply_header(path: Path, wanted: Sequence[str | int] = ()) -> PlyHeader:
    """Return the header of the PLY at `path`.

    Args:
        path: file.
        wanted: properties of a vertex that are x, y and z, by name, or number from 1. Empty: x, y and z.

    Raises:
        ConfigError: If it is not a PLY, or its vertices lack x, y or z.
        OSError: If it cannot be read.
    """
    with path.open("rb") as file:
        order, elements, comments = _read_lines(path, file)
        body = file.tell()
    index = next((at for at, each in enumerate(elements) if each.name == "vertex"), None)
    if index is None:
        raise ConfigError(f"{path}: has no element vertex; give a PLY with points")
    vertex = elements[index]
    names = [each.name for each in vertex.properties]
    try:
        columns = named_columns(wanted or AXES, names, len(names))
    except ConfigError as error:
        if wanted:
            raise ConfigError(f"{path}: {error}") from error
        missing = [axis for axis in AXES if [name.lower() for name in names].count(axis) != 1]
        raise ConfigError(
            f"{path}: its vertices have {join_names(names) or 'nothing'}, not {join_names(missing)} once; "
            "export it with x, y and z, or write in the map which they are, such as columns: [px, py, pz]"
        ) from error
    for column in columns.indices:
        if vertex.properties[column].count_kind:
            raise ConfigError(f"{path}: {names[column]} is a list; export it with a number x, y and z each")
    return PlyHeader(
        order=order,
        body=body,
        before=elements[:index],
        vertex=vertex,
        columns=list(columns.indices),
        units=columns.units,
        comments=comments,
    )


def _read_lines(path: Path, file: BinaryIO) -> tuple[str, list[Element], list[str]]:
    """Return order, elements and comments. Afterwards `file` is at the body."""
    end = _line_end(file)
    if _read_line(file, end).strip() != b"ply":
        raise ConfigError(
            f"{path}: does not begin with `ply`; give a PLY file, or rename it to .xyz if it is plain text"
        )
    order: str | None = None
    elements: list[Element] = []
    comments: list[str] = []
    for number in range(2, MAX_HEADER_LINES + 2):
        line = _read_line(file, end)
        words = line.decode(errors="replace").split()
        if not line:
            break
        if words == ["end_header"] and order is not None:
            return order, elements, comments
        try:
            if words[:1] == ["format"]:
                order = _order(words)
            elif words[:1] in (["comment"], ["obj_info"]):
                comments.append(" ".join(words[1:]))
            else:
                _parse_line(words, elements)
        except (KeyError, IndexError, ValueError):
            raise ConfigError(
                f"{path}: line {number} of its header is not understood, {format_value(' '.join(words))}; "
                "export it as PLY 1.0 again"
            ) from None
    raise ConfigError(f"{path}: its header does not end; it is cut off or not a PLY, copy or export it again")


def _line_end(file: BinaryIO) -> bytes:
    """Return the end of the lines of a header. Afterwards `file` is behind its byte order mark, if any."""
    start = file.read(_MAX_LINE)
    file.seek(len(_BYTE_ORDER_MARK) if start.startswith(_BYTE_ORDER_MARK) else 0)
    ends = [(at, end) for end in (b"\n", b"\r\n", b"\r") if (at := start.find(end)) >= 0]
    return max(ends, key=lambda each: (-each[0], len(each[1])))[1] if ends else b"\n"


def _read_line(file: BinaryIO, end: bytes) -> bytes:
    """Return the next line with its `end`, at most `_MAX_LINE` bytes."""
    if end.endswith(b"\n"):
        return file.readline(_MAX_LINE)
    start = file.tell()
    line = file.read(_MAX_LINE)
    if (at := line.find(end)) >= 0:
        line = line[: at + 1]
        file.seek(start + len(line))
    return line


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
