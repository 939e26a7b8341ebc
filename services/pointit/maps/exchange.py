"""Maps beside those of other LED programs: WLED's segments and ledmap, and pixels as CSV (x, y, z)."""

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Container, Iterator, Mapping, Sequence
from itertools import count
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from pointit.geometry.polyline import Polyline
from pointit.maps.model import MAX_PIXELS, MapFile, StripEntry
from pointit.runtime.errors import ConfigError
from pointit.schemas import FARTHEST

Array = NDArray[np.float64]

MAX_POINTS = 100_000
MAX_CELLS = 1_000_000
"""Limit of the cells of a ledmap."""
GAP = 3.0
"""Step between two pixels, in medians of all steps, from which another strip begins."""
STRAIGHT = 0.5
"""Distance of pixels from a straight piece, in steps from pixel to pixel, up to which it is straight."""
VIEWS = {"top": (0, 1), "front": (0, 2), "side": (1, 2)}
"""Axes that become columns and rows of a ledmap."""


def positions(strip: StripEntry) -> Array:
    """Return the positions of a strip's pixels in the order of its wire, n x 3, m."""
    line = Polyline(strip.line)
    points = line.points_at((np.arange(strip.pixels) + 0.5) * line.length_m / strip.pixels)
    return points if strip.direction == 1 else points[::-1]


def to_csv(file: MapFile) -> str:
    """Return all pixels as CSV with the columns x, y, z, strip, pixel: m, in the order of the map.

    xLights and most other programs read the first three columns, one line for each pixel.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("x", "y", "z", "strip", "pixel"))
    for name, strip in file.strips.items():
        for pixel, point in enumerate(positions(strip)):
            writer.writerow((*(f"{value:.4f}" for value in point), name, pixel))
    return text.getvalue()


def from_csv(text: str) -> dict[str, StripEntry]:
    """Return the strips of a CSV with one pixel a line.

    With a header, the columns x, y, z are used, and strip (or name) and pixel (or index) if there are such.
    Without one the first three, or the last three of four. Without names, a strip ends where the next pixel
    is far away. Corners are found.

    Raises:
        ConfigError: If a line is not such, or there are too many. Names the line.
    """
    strips: dict[str, list[tuple[float, Array]]] = {}
    for number, (name, pixel, point) in enumerate(_rows(text)):
        if number == MAX_POINTS:
            raise ConfigError(f"more than {MAX_POINTS} pixels")
        strips.setdefault(name, []).append((number if pixel is None else pixel, point))
    found: dict[str, StripEntry] = {}
    for name, pixels in strips.items():
        points = np.array([point for _, point in sorted(pixels, key=lambda each: each[0])])
        for part in _runs(points) if not name else [points]:
            key = name or _free(f"strip_{len(found) + 1}", {*strips, *found})
            if len(part) < 2:
                raise ConfigError(f"{key}: one pixel alone is no strip; it needs two")
            found[key] = _strip_through(part)
    if not found:
        raise ConfigError("there are no pixels: write one a line, as x,y,z in metres")
    return found


def _rows(text: str) -> Iterator[tuple[str, float | None, Array]]:
    columns: dict[str, int] | None = None
    try:
        rows = list(csv.reader(text.splitlines()))
    except csv.Error as error:
        raise ConfigError(f"no CSV: {error}") from error
    for number, row in enumerate(rows, 1):
        cells = [cell.strip() for cell in row]
        if not any(cells):
            continue
        if columns is None:
            names = {cell.lower(): index for index, cell in enumerate(cells)}
            if {"x", "y", "z"} <= names.keys():
                columns = names
                continue
            first = 1 if len(cells) == 4 else 0
            columns = {"x": first, "y": first + 1, "z": first + 2} | ({"pixel": 0} if first else {})
        try:
            point = np.array([float(cells[columns[axis]]) for axis in "xyz"])
            index = columns.get("pixel", columns.get("index"))
            pixel = None if index is None else float(cells[index])
            label = columns.get("strip", columns.get("name"))
            name = "" if label is None else cells[label]
        except (IndexError, ValueError):
            raise ConfigError(
                f"line {number}: {','.join(row)[:60]!r} is no pixel; write x,y,z in metres"
            ) from None
        if not np.all(np.abs([*point, pixel or 0.0]) <= FARTHEST):
            raise ConfigError(
                f"line {number}: {','.join(row)[:60]!r} is no pixel; write numbers up to {FARTHEST:g}"
            )
        yield name, pixel, point


def _runs(points: Array) -> list[Array]:
    """Return the parts of `points` between which there are gaps."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if not len(steps):
        return [points]
    return np.split(points, np.flatnonzero(steps > GAP * np.median(steps)) + 1)


def _strip_through(points: Array) -> StripEntry:
    """Return the strip with corners whose pixels are at `points`, n x 3."""
    step = float(np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    if len(points) > MAX_PIXELS or step <= 0:
        raise ConfigError(f"{len(points)} pixels, {step:g} m apart: no strip")
    kept = sorted({0, len(points) - 1, *_corners(points, 0, len(points) - 1, STRAIGHT * step)})
    vertices = points[kept]
    first, last = vertices[1] - vertices[0], vertices[-1] - vertices[-2]
    vertices[0] -= first / np.linalg.norm(first) * step / 2  # a line reaches half a pixel beyond its ends
    vertices[-1] += last / np.linalg.norm(last) * step / 2
    return _entry([[round(float(value), 4) for value in vertex] for vertex in vertices], len(points))


def _entry(line: Sequence[Sequence[float]], pixels: int) -> StripEntry:
    """Return a strip. Raises ConfigError if no map can have it."""
    try:
        return StripEntry.model_validate({"line": line, "pixels": pixels})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"a strip of {pixels} pixels: {where}: {first['msg']}") from None


def _free(name: str, taken: Container[str]) -> str:
    """Return `name`, with a number if it is `taken`."""
    numbered = (f"{name[:60]}_{number}" for number in count(2))
    return name if name not in taken else next(each for each in numbered if each not in taken)


def _corners(points: Array, first: int, last: int, limit_m: float) -> Iterator[int]:
    """Yield the corners: between them all points are within `limit_m` of a line (Douglas-Peucker)."""
    stack = [(first, last)]
    while stack:
        low, high = stack.pop()
        if high - low < 2:
            continue
        chord = points[high] - points[low]
        away = points[low + 1 : high] - points[low]
        length = float(np.linalg.norm(chord))
        along = np.clip(away @ chord / max(length, 1e-12) ** 2, 0.0, 1.0)
        apart = np.linalg.norm(away - along[:, None] * chord, axis=1)
        worst = int(np.argmax(apart))
        if apart[worst] > limit_m:
            corner = low + 1 + worst
            yield corner
            stack += [(low, corner), (corner, high)]


def to_segments(file: MapFile) -> str:
    """Return the strips as WLED segments, JSON for its /json/state: one wire, in the order of the map."""
    segments: list[dict[str, object]] = []
    start = 0
    for number, (name, strip) in enumerate(file.strips.items()):
        stop = start + strip.pixels
        segments.append({"id": number, "n": name, "start": start, "stop": stop, "rev": False})
        start = stop
    return json.dumps({"seg": segments})


def from_segments(text: str) -> dict[str, int]:
    """Return the names and pixel counts of WLED segments: a state, what has one, or a list of segments.

    What a map's names cannot have becomes `_`, and a second segment of a name gets a number.

    Raises:
        ConfigError: If it is not such.
    """
    data = _json(text)
    for key in ("state", "seg"):
        if isinstance(data, dict):
            data = cast("dict[str, Any]", data).get(key, data)
    counts: dict[str, int] = {}
    try:
        for segment in cast("list[Mapping[str, Any]]", data):
            pixels = _whole(segment["stop"]) - _whole(segment["start"])
            if pixels > 0:
                name = re.sub(r"[^A-Za-z0-9_.-]+", "_", str(segment.get("n") or "")).lstrip("-.")[:64]
                counts[_free(name or f"segment_{segment.get('id', len(counts))}", counts)] = pixels
    except (KeyError, TypeError, AttributeError):
        raise ConfigError('no segments of WLED: {"seg": [{"start": 0, "stop": 60, "n": "desk"}]}') from None
    if not counts:
        raise ConfigError("there are no segments with pixels")
    return counts


def laid_out(counts: Mapping[str, int], pitch_m: float) -> dict[str, StripEntry]:
    """Return strips of `counts` pixels one above the other, to be moved to where they are."""
    return {
        name: _entry(
            [[0.0, 0.0, round(0.1 * row, 1)], [round(pixels * pitch_m, 4), 0.0, round(0.1 * row, 1)]], pixels
        )
        for row, (name, pixels) in enumerate(counts.items())
    }


def to_ledmap(file: MapFile, view: str, cell_m: float) -> str:
    """Return the strips as WLED's ledmap.json: a grid of cells seen from the top, front or side.

    Each cell has the number of its pixel, -1 if there is none. Two pixels in one cell: the first counts.

    Raises:
        ConfigError: If the grid would be too large, or there are no strips.
    """
    if not file.strips:
        raise ConfigError("the map has no strips")
    points = np.concatenate([positions(strip) for strip in file.strips.values()])[:, VIEWS[view]]
    low = points.min(axis=0)
    cells = np.floor((points - low) / cell_m + 0.5).astype(np.intp)
    width, height = (int(value) + 1 for value in cells.max(axis=0))
    if width * height > MAX_CELLS:
        raise ConfigError(f"{width} x {height} cells are too many; write a larger --cell")
    grid = np.full((height, width), -1)
    for number in reversed(range(len(cells))):
        column, row = int(cells[number, 0]), int(cells[number, 1])
        grid[height - 1 - row, column] = number
    return json.dumps(
        {"n": view, "width": width, "height": height, "map": grid.ravel().tolist()}, separators=(",", ":")
    )


def from_ledmap(text: str, cell_m: float) -> dict[str, StripEntry]:
    """Return the strips of a WLED ledmap with width and height, on an upright plane, `cell_m` a cell.

    Raises:
        ConfigError: If it is not such.
    """
    data = _json(text)
    try:
        width, height = _whole(data["width"]), _whole(data["height"])
        cells = [_whole(number) for number in data["map"]]
    except (KeyError, TypeError):
        width, height, cells = 0, 0, []
    if not (0 < width * height <= MAX_CELLS and width > 0 and len(cells) == width * height):
        raise ConfigError("no ledmap of WLED with width, height and as many numbers in map")
    lit = sorted((number, index) for index, number in enumerate(cells) if number >= 0)
    if len(lit) < 2:
        raise ConfigError("the ledmap has fewer than two pixels")
    places = np.array(
        [[index % width, 0.0, height - 1 - index // width] for _, index in lit], dtype=np.float64
    )
    found: dict[str, StripEntry] = {}
    for part in _runs(places * cell_m):
        if len(part) < 2:
            raise ConfigError("one pixel is far from those before and after it, and alone is no strip")
        found[f"strip_{len(found) + 1}"] = _strip_through(part)
    return found


def _whole(value: object) -> int:
    if type(value) is not int:
        raise TypeError
    return value


def _json(text: str) -> Any:
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"no JSON: {error}") from None


def _unique(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        twice = next(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
        raise ValueError(f"{twice!r} is there twice, keep one")
    return data


def strips_text(strips: Mapping[str, StripEntry]) -> str:
    """Return the text of a map of `strips`."""
    lines = ["strips:"]
    for name, strip in strips.items():
        lines += [
            f"  {json.dumps(name)}:",
            f"    line: {[list(point) for point in strip.line]}",
            f"    pixels: {strip.pixels}",
        ]
    return "\n".join([*lines, ""])
