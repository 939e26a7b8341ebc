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
    remaining = sorted(objects, key=lambda tracked: (_edge_m(tracked, -1), tracked.id), reverse=True)
    rows: list[list[str]] = []
    while remaining:
        line_m = _edge_m(remaining[0], -1)
        row: list[TrackedObject] = []
        lower: list[TrackedObject] = []
        for tracked in remaining:
            if _edge_m(tracked, 1) >= line_m:
                row.append(tracked)
            else:
                lower.append(tracked)
        rows.append(_from_left(row, origin_m))
        remaining = lower
    return rows


def _edge_m(tracked: TrackedObject, side: int) -> float:
    """Return the height of the upper (1) or lower (-1) edge of an object's core, m."""
    height_m = tracked.length_m
    if tracked.size_m is not None:
        height_m = tracked.size_m[2]
    return tracked.position_m[2] + side * CORE * max(height_m, MIN_HEIGHT_M) / 2.0


def _from_left(row: Iterable[TrackedObject], origin_m: Vec3) -> list[str]:
    """Return the ids of a row from left to right, from behind its widest gap on."""
    azimuths: list[tuple[float, str]] = []
    for tracked in row:
        to_object = vector.subtract(tracked.position_m, origin_m)
        azimuths.append((vector.azimuth(to_object), tracked.id))
    azimuths.sort(reverse=True)
    gaps: list[float] = []
    for index, (azimuth, _) in enumerate(azimuths):
        left_azimuth, _ = azimuths[index - 1]  # of the first one: the last one, around the person
        gaps.append((left_azimuth - azimuth) % math.tau)
    first = gaps.index(max(gaps))
    return [object_id for _, object_id in azimuths[first:] + azimuths[:first]]


def neighbour(objects: Iterable[TrackedObject], cursor: Cursor, object_id: str, step: Step) -> str:
    """Return the object to which `step` leads from `object_id`, as the person sees it.

    At the end of a row, or of the rows, that is `object_id` itself. If it is not among `objects`, the result
    is the object nearest to the ray, or `""` if there are none.
    """
    by_id = {tracked.id: tracked for tracked in objects}
    if cursor.origin_m is None or cursor.direction is None:
        return ""
    if not by_id:
        return ""
    origin_m = cursor.origin_m
    direction = cursor.direction
    offsets_m: dict[str, Vec3] = {}
    for tracked_id, tracked in by_id.items():
        offsets_m[tracked_id] = vector.subtract(tracked.position_m, origin_m)
    if object_id not in by_id:
        return min(offsets_m, key=lambda name: (vector.angle_between(direction, offsets_m[name]), name))

    # Beside it in its row
    rows = rows_of(by_id.values(), origin_m)
    number, row = _row_of(rows, object_id)
    if step.to == "beside":
        index = row.index(object_id) + step.by
        return row[min(max(index, 0), len(row) - 1)]

    # Above or below it: the object of that row in the most similar direction
    new_number = number
    if step.to == "row":
        new_number += step.by
    if new_number == number or not 0 <= new_number < len(rows):
        return object_id
    azimuth = vector.azimuth(offsets_m[object_id])
    azimuth_errors: dict[str, float] = {}
    for name in rows[new_number]:
        azimuth_errors[name] = abs(vector.wrap(vector.azimuth(offsets_m[name]) - azimuth))
    return min(azimuth_errors, key=azimuth_errors.__getitem__)


def place_in(rows: Rows, object_id: str) -> str:
    """Return the place of an object that is in `rows`, such as `2 of 4, upper row`."""
    number, row = _row_of(rows, object_id)
    place = f"{row.index(object_id) + 1} of {len(row)}"
    if len(rows) == 1:
        return place
    row_name = f"row {number + 1} of {len(rows)} from above"
    if len(rows) in ROWS:
        row_name = ROWS[len(rows)][number]
    return f"{place}, {row_name}"


def _row_of(rows: Rows, object_id: str) -> tuple[int, Sequence[str]]:
    """Return the row of an object that is in `rows`, with its number from 0."""
    return next((number, row) for number, row in enumerate(rows) if object_id in row)
