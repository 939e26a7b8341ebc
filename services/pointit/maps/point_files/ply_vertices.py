"""Vertices of a PLY file, text or binary, also behind and beside lists."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pointit.maps.point_files.ply_header import Element, PlyHeader


def binary_vertices(path: Path, header: PlyHeader) -> NDArray[np.float64]:
    """Return x, y, z of the vertices, n x 3. Fewer than in the header if the file is cut off.

    Raises:
        OSError: If it cannot be read.
    """
    has_lists = any(each.has_list and each.rows for each in (*header.before, header.vertex))
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
            return np.column_stack([table[f"f{column}"].astype(np.float64) for column in header.columns])
    offsets = list(_rows_of(data, offset, header.vertex, header.order, header.columns))
    starts = np.array(offsets, dtype=np.int64).reshape(-1, 3)
    kinds = [header.order + header.vertex.properties[column].kind for column in header.columns]
    with np.errstate(invalid="ignore"):
        return np.column_stack([_values_at(data, starts[:, at], kind) for at, kind in enumerate(kinds)])


def ascii_vertex_lines(lines: Iterable[str], header: PlyHeader) -> Iterator[str]:
    """Yield x, y and z of each vertex of a text whose vertices have lists before them, a line each."""
    for line in lines:
        words = line.split()
        starts: list[int] = []
        at = 0
        for each in header.vertex.properties[: max(header.columns) + 1]:
            starts.append(at)
            count = words[at] if each.count_kind and at < len(words) else "0"
            at += 1 + (int(count) if count.isdecimal() else len(words))
        if words:
            yield " ".join(words[starts[column]] for column in header.columns if starts[column] < len(words))


def _row_type(element: Element, order: str) -> np.dtype[np.void]:
    """Return the layout of a row without lists, with fields f0, f1, … as a PLY may have a name twice."""
    return np.dtype([(f"f{at}", order + each.kind) for at, each in enumerate(element.properties)])


def _end_of(data: NDArray[np.uint8], offset: int, element: Element, order: str) -> int:
    """Return the offset behind the rows of `element`, which begin at `offset`."""
    if not element.has_list:
        return offset + _row_type(element, order).itemsize * element.rows
    if not element.rows:
        return offset
    if (size := _equal_row_size(data, offset, element, order)) is not None:
        return offset + size * element.rows
    ends = _rows_of(data, offset, element, order, [len(element.properties)])
    last = deque(ends, maxlen=1)
    return last[0][0] if last else offset


def _equal_row_size(data: NDArray[np.uint8], offset: int, element: Element, order: str) -> int | None:
    """Return the size of the rows of `element` if all have lists of the sizes of the first, as triangles."""
    fields: list[tuple[str, str, int]] = []
    counts: dict[str, int] = {}
    at = offset
    for number, each in enumerate(element.properties):
        if each.count_kind:
            kind = np.dtype(order + each.count_kind)
            if at + kind.itemsize > len(data):
                return None
            counts[f"n{number}"] = int(data[at : at + kind.itemsize].view(kind)[0])
            fields.append((f"n{number}", kind.str, 1))
            at += kind.itemsize
        size = counts.get(f"n{number}", 1)
        if size < 0:
            return None
        fields.append((f"f{number}", order + each.kind, size))
        at += size * np.dtype(each.kind).itemsize
    row = np.dtype([(name, kind, (size,)) for name, kind, size in fields])
    end = offset + row.itemsize * element.rows
    if end > len(data):
        return None
    table = data[offset:end].view(row)
    return row.itemsize if all(bool((table[name] == count).all()) for name, count in counts.items()) else None


def _rows_of(
    data: NDArray[np.uint8], offset: int, element: Element, order: str, columns: Sequence[int]
) -> Iterator[list[int]]:
    """Yield the offsets of the properties `columns` of each row of `element`, until a row is not whole.

    The offset of the property behind the last one is the end of the row.
    """
    content = data.tobytes()
    byte_order: Literal["little", "big"] = "little" if order == "<" else "big"
    sizes = [np.dtype(each.kind).itemsize for each in element.properties]
    count_sizes = [
        np.dtype(each.count_kind).itemsize if each.count_kind else 0 for each in element.properties
    ]
    for _ in range(element.rows):
        starts: list[int] = []
        for size, count_size in zip(sizes, count_sizes, strict=True):
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
    size = np.dtype(kind).itemsize
    values: NDArray[np.float64] = data[starts[:, None] + np.arange(size)].view(kind)[:, 0].astype(np.float64)
    return values
