"""Rows of objects as a person sees them, and steps among them."""

import math
from collections.abc import Iterable, Sequence

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import Cursor, Step, TrackedObject

Rows = Sequence[Sequence[str]]

MIN_HEIGHT_M = 0.1
"""Minimum height of objects for which rows are made, m: trackers measure heights with errors."""
CORE = 0.8
"""Share of an object's height, about its middle, that counts: objects that only touch are in two rows."""
ROWS = {2: ("upper row", "lower row"), 3: ("upper row", "middle row", "lower row")}
"""Names of rows by their number."""


def rows_of(objects: Iterable[TrackedObject], origin_m: Vec3) -> Rows:
    """Return ids by rows, the upper one first, each from left to right as seen from `origin_m`.

    A level line crosses all objects of a row. A row around the person begins behind its widest gap.
    """
    rest = sorted(objects, key=lambda each: (_edge_m(each, -1), each.id), reverse=True)
    rows: list[list[str]] = []
    while rest:
        line_m = _edge_m(rest[0], -1)
        rows.append(_from_left([each for each in rest if _edge_m(each, 1) >= line_m], origin_m))
        rest = [each for each in rest if _edge_m(each, 1) < line_m]
    return rows


def _edge_m(tracked: TrackedObject, side: int) -> float:
    """Return the height of the upper (1) or lower (-1) edge of an object's core, m."""
    height_m = tracked.length_m if tracked.size_m is None else tracked.size_m[2]
    return tracked.position_m[2] + side * CORE * max(height_m, MIN_HEIGHT_M) / 2.0


def _from_left(row: Iterable[TrackedObject], origin_m: Vec3) -> list[str]:
    around = sorted(
        ((vector.azimuth(vector.subtract(each.position_m, origin_m)), each.id) for each in row), reverse=True
    )
    gaps = [(around[index - 1][0] - around[index][0]) % math.tau for index in range(len(around))]
    first = gaps.index(max(gaps))
    return [name for _, name in around[first:] + around[:first]]


def neighbour(objects: Iterable[TrackedObject], cursor: Cursor, object_id: str, step: Step) -> str:
    """Return the object to which `step` leads from `object_id`, as the person sees it.

    At the end of a row, or of the rows, that is `object_id` itself. If it is not among `objects`, it is the
    one nearest to the ray, or `""` if there are none.
    """
    by_id = {one.id: one for one in objects}
    if cursor.origin_m is None or cursor.direction is None or not by_id:
        return ""
    origin_m = cursor.origin_m
    direction = cursor.direction
    reach = {name: vector.subtract(one.position_m, origin_m) for name, one in by_id.items()}
    if object_id not in by_id:
        return min(reach, key=lambda name: (vector.angle_between(direction, reach[name]), name))
    rows = rows_of(by_id.values(), origin_m)
    number, row = next((i, row) for i, row in enumerate(rows) if object_id in row)
    if step.to == "beside":
        return row[min(max(row.index(object_id) + step.by, 0), len(row) - 1)]
    beside = number + step.by if step.to == "row" else number
    if beside == number or not 0 <= beside < len(rows):
        return object_id
    azimuth = vector.azimuth(reach[object_id])
    return min(rows[beside], key=lambda name: abs(vector.wrap(vector.azimuth(reach[name]) - azimuth)))


def place_in(rows: Rows, object_id: str) -> str:
    """Return the place of an object that is in `rows`, such as `2 of 4, upper row`."""
    number, row = next((i, row) for i, row in enumerate(rows) if object_id in row)
    place = f"{row.index(object_id) + 1} of {len(row)}"
    if len(rows) == 1:
        return place
    names = ROWS.get(len(rows))
    return f"{place}, {f'row {number + 1} of {len(rows)} from above' if names is None else names[number]}"
