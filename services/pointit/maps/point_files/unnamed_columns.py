"""Columns without names: reasons for which the first ones may be no coordinates."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.maps.point_files.point_columns import is_number

_COLORED = 5
"""Number of columns from which more may be colours and coordinates."""
_MIN_RISING_ROWS = 3
"""Number of rows from which a first column that rises in each row is an index or a time."""
_MIN_RISING_SHARE = 0.5
"""Share of the steps that rise in a column of times, of which several rows may have the same."""


def first_columns_problem(rows: Sequence[Sequence[str]]) -> tuple[str, int]:
    """Return the reason for which first columns of `rows` may be no coordinates, and their number.

    The reason is `""` if there is none.

    A number of the point, its time, the row and column of a scanner, an intensity or a colour may be first.
    Cells behind the numbers may be a code or a label.
    """
    points = [row for row in rows if len(row) > 3 and all(map(is_number, row[:3]))]
    count = min((_leading_numbers(row) for row in points), default=0)
    if count < 3:
        return "", 0
    cells = [row[:count] for row in points]
    numbers = np.array([[float(cell.replace(",", ".")) for cell in row] for row in cells])
    are_whole = [all(cell.lstrip("-").isdecimal() for cell in column) for column in zip(*cells, strict=True)]
    if count > _COLORED and _has_colors_first(cells, numbers):
        return "the first three may be colours", 3
    if _is_index_or_time(numbers, are_whole):
        return "the first counts the rows or has their time", 1
    whole = (*are_whole, False).index(False)
    if whole and are_whole[whole : whole + 3] == [False] * 3:
        return f"the first {whole} may be no coordinates", whole
    if count == 4 and are_whole[0] and all(len(row) > count for row in points):
        return "the first may be the number of the point", 1
    return "", 0


def _leading_numbers(row: Sequence[str]) -> int:
    return next((at for at, cell in enumerate(row) if not is_number(cell)), len(row))


def _is_index_or_time(numbers: NDArray[np.float64], are_whole: Sequence[bool]) -> bool:
    """Return True if the first column rises from row to row, and is not x before colours or normals."""
    steps = np.diff(numbers[:, 0])
    if len(steps) < _MIN_RISING_ROWS - 1 or not (steps >= 0.0).all():
        return False
    if are_whole[0]:
        return bool((steps > 0.0).all()) and (numbers.shape[1] > 3 or bool((steps == 1.0).all()))
    if numbers.shape[1] == 3 or (steps > 0.0).mean() <= _MIN_RISING_SHARE:
        return False
    last = numbers[:, 3:]
    if any(are_whole[3:]) and (np.diff(last[:, are_whole[3:]], axis=0) > 0.0).all(axis=0).any():
        return False  # the number of the point is behind the coordinates
    has_colors = all(are_whole[3:]) and last.min() >= 0 and last.max() <= 255
    has_normals = np.allclose(np.linalg.norm(last, axis=1), 1.0, atol=0.02)
    return not (last.shape[1] == 3 and (has_colors or has_normals))


def _has_colors_first(cells: Sequence[Sequence[str]], numbers: NDArray[np.float64]) -> bool:
    """Return True if the first three of six or more columns look like colours, and later ones do not."""
    if numbers[:, :3].min() < 0:
        return False
    are_bytes = (
        (numbers == np.floor(numbers)).all(axis=0) & (numbers.min(axis=0) >= 0) & (numbers.max(axis=0) <= 255)
    )
    has_colors_later = any(are_bytes[at : at + 3].all() for at in range(3, numbers.shape[1] - 2))
    has_normals = np.allclose(np.linalg.norm(numbers[:, 3:6], axis=1), 1.0, atol=0.02)
    limit = 255.0 if all(cell.isdecimal() for row in cells for cell in row[:3]) else 1.0
    is_beyond = (
        numbers[:, 3:].min() < 0 or numbers[:, 3:].max() > limit or (limit > 1 and not are_bytes[3:].all())
    )
    return bool(numbers[:, :3].max() <= limit and is_beyond and not has_colors_later and not has_normals)
