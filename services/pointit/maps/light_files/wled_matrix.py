"""Matrix of WLED's configuration: panels of pixels, and the order in which the wire goes through them."""

from collections.abc import Iterator, Mapping
from typing import Any, cast

from pointit.maps.light_files.wled import MAX_CELLS, inside, list_of, read_json, whole_number
from pointit.runtime.config.validation_message import format_value
from pointit.runtime.errors import ConfigError

Cell = tuple[int, int]
"""Column and row, from 0; the first row is at the top."""


def read_matrix(text: str) -> tuple[list[Cell], int] | None:
    """Return the cell of each pixel of a matrix in the order of the wire, and the number of pixels behind it.

    Args:
        text: JSON of `cfg.json` or `/json/cfg`.

    Returns:
        None if it configures no matrix.

    Raises:
        ConfigError: If a panel has no size, or two share a cell. One sentence.
    """
    led = inside(read_json(text), "hw", "led")
    if not (panels := list_of(inside(led, "matrix", "panels"))):
        return None
    count = whole_number(inside(led, "matrix", "mpc") or len(panels), "mpc of hw.led.matrix")
    cells: dict[Cell, int] = {}
    for number, panel in enumerate(panels[:count]):
        where = f"panel {number} of hw.led.matrix"
        if not isinstance(panel, dict):
            raise ConfigError(f"{where} is {format_value(panel)}; give WLED's cfg.json")
        for cell in _panel_cells(cast("Mapping[str, Any]", panel), where):
            if (other := cells.setdefault(cell, number)) != number:
                raise ConfigError(
                    f"{where} has column {cell[0]}, row {cell[1]}, which is of panel {other}, too; correct x "
                    "and y of the panels in WLED's 2D configuration"
                )
    ends = [_end(each) for each in list_of(inside(led, "ins"))]
    return list(cells), max(max(ends, default=0) - len(cells), 0)


def _panel_cells(panel: Mapping[str, Any], where: str) -> Iterator[Cell]:
    """Yield the cells of a panel in the order of its wire."""
    width, height, x, y = (whole_number(panel.get(key) or 0, f"{key} of {where}") for key in "whxy")
    if width < 1 or height < 1 or min(x, y) < 0 or width * height > MAX_CELLS:
        raise ConfigError(f"{where} has {width} x {height} pixels at {x}, {y}; give each panel its size")
    from_bottom, from_right, is_vertical, is_serpentine = (bool(panel.get(key)) for key in "brvs")
    lines, length = (width, height) if is_vertical else (height, width)
    starts_far, lines_from_far = (from_bottom, from_right) if is_vertical else (from_right, from_bottom)
    for line in range(lines):
        across = lines - 1 - line if lines_from_far else line
        is_backwards = starts_far != (is_serpentine and line % 2 == 1)
        for step in range(length):
            along = length - 1 - step if is_backwards else step
            yield (x + across, y + along) if is_vertical else (x + along, y + across)


def _end(output: object) -> int:
    """Return the number of the pixel behind an output."""
    start, length = (inside(output, key) or 0 for key in ("start", "len"))
    return whole_number(start, "start of hw.led.ins") + whole_number(length, "len of hw.led.ins")
