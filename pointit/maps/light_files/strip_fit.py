"""Strips through pixels: an even line for each run, its name, and numbers of pixels on the wire.

A strip of a map has its pixels evenly along its line. Pixels of other programs have bends, other pitches,
slack between them, and may share a position. The line of irregular pixels makes a detour between two that are
nearer than the others, as the wire does.
"""

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, pairwise

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from pointit.geometry.array_types import Array
from pointit.geometry.polyline import Polyline
from pointit.maps.model import MAX_PIXELS, StripEntry
from pointit.runtime.config.validation_message import format_value
from pointit.runtime.errors import ConfigError
from pointit.schemas.table_types import valid_name
from pointit.schemas.text import describe_mistake

Note = Callable[[str], object]
"""Receives a sentence on what differs from the file."""

MAX_STRIPS = 4000
MAX_SLACK = 6.0
"""Step, in median steps, from which pixels without names of strips are refused if no gap is declared."""
MAX_OFFSET = 0.1
"""Distance of a pixel of a strip from that of the file, in steps, up to which it is the same."""
MAX_OFFSET_M = 0.005
"""Limit of that distance, m."""
EVEN = 0.05
"""Difference of two steps, in steps, up to which both are the same."""
MAX_BENDS = 0.2
"""Share of steps round a bend, up to which a run is an even strip."""


def first_pixels(strips: Mapping[str, StripEntry]) -> dict[str, int]:
    """Return the number on the wire of the first pixel of each strip."""
    firsts: dict[str, int] = {}
    end = 0
    for name, strip in strips.items():
        firsts[name] = end if strip.offset is None else strip.offset
        end = firsts[name] + strip.pixels
    return firsts


def unused_pixels(strips: Mapping[str, StripEntry]) -> Iterator[tuple[int, int]]:
    """Yield first and last of the pixels of the wire that are in no strip, before or between others."""
    end = 0
    for first, name in sorted((first, name) for name, first in first_pixels(strips).items()):
        if first > end:
            yield end, first - 1
        end = max(end, first + strips[name].pixels)


def shared_pixels(strips: Mapping[str, StripEntry]) -> Iterator[tuple[str, str]]:
    """Yield pairs of strips with common pixels of the wire, the later one first.

    There are none unless a strip has an offset.
    """
    if all(strip.offset is None for strip in strips.values()):
        return
    firsts = first_pixels(strips)
    ordered = sorted((first, first + strips[name].pixels, name) for name, first in firsts.items())
    longest = ordered[0]
    for before, (first, end, name) in pairwise(ordered):
        longest = max(longest, before, key=lambda each: each[1])
        if first < longest[1]:
            yield name, longest[2]
        longest = max(longest, (first, end, name), key=lambda each: each[1])


@dataclass(frozen=True, kw_only=True)
class FittedStrip:
    """Consecutive pixels, evenly along a line."""

    first: int
    """Index of its first pixel among those of the file."""
    pixels: int
    line: Array
    """Vertices, n x 3, m. The line reaches half a pixel beyond its ends."""


def fit_strips(
    points: Array, numbers: NDArray[np.intp], usual: float, gap_m: float = math.inf
) -> Iterator[FittedStrip]:
    """Yield the strips through `points` in their order.

    A strip ends before a number that is skipped, and before a step above `gap_m`.

    Args:
        points: positions of pixels, n x 3, m.
        numbers: their numbers on the wire, n, ascending.
        usual: length of a pixel that is alone, m.
        gap_m: longest step within a strip, m.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    edges = np.flatnonzero((np.diff(numbers) != 1) | (steps > gap_m)) + 1
    for start, stop in pairwise([0, *edges.tolist(), len(points)]):
        for first in range(start, stop, MAX_PIXELS):
            run = points[first : min(first + MAX_PIXELS, stop)]
            yield FittedStrip(first=first, pixels=len(run), line=_fitted_line(run, usual))


def check_steps(points: Array) -> None:
    """Check that `points` in their order, n x 3, m, may be one strip.

    Raises:
        ConfigError: If two of them are much farther apart than the others.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    step = median_step(steps)
    if step and (longest := float(steps.max())) > MAX_SLACK * step:
        at = int(np.argmax(steps))
        raise ConfigError(
            f"pixels {at} and {at + 1} are {longest:.3g} m apart, and others {step:.3g} m; name strips in a "
            f"column strip, or set gap to the longest step within a strip, such as {2.0 * step:.3g}"
        )


def pixels_along(line: Array, pixels: int) -> Array:
    """Return the positions of a strip's pixels from the line's first vertex on, n x 3, m."""
    polyline = Polyline(line.tolist())
    return polyline.points_at((np.arange(pixels) + 0.5) * polyline.length_m / pixels)


def median_step(steps: Array) -> float:
    """Return the median of the steps that are not zero, 0 if all are."""
    moved = steps[steps > 0.0]
    return float(np.median(moved)) if len(moved) else 0.0


def _fitted_line(points: Array, usual: float) -> Array:
    """Return the line along which `points` are even; `usual` is the step where there is none."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    step = median_step(steps) or usual
    limit = min(MAX_OFFSET * min(step, usual), MAX_OFFSET_M)
    even = steps[np.abs(steps - step) <= EVEN * step]
    candidates: list[Callable[[], Array]] = [lambda: _smooth(points, step, limit)]
    if len(even) >= (1 - MAX_BENDS) * len(steps):
        pitch = float(even.mean()) if len(even) else step
        candidates.insert(0, lambda: _bent(points, pitch, EVEN))
    for candidate in candidates:
        line = candidate()
        if np.linalg.norm(pixels_along(line, len(points)) - points, axis=1).max() <= limit:
            return line
    return _bent(points, float(steps.max()) or usual, 1e-6)


def _smooth(points: Array, step: float, limit: float) -> Array:
    """Return the line through the corners of evenly spaced pixels."""
    vertices = _vertices(np.arange(len(points), dtype=np.float64), points, limit)
    return _with_ends(points[vertices], step)


def _bent(points: Array, pitch: float, tolerance: float) -> Array:
    """Return the line through all pixels, `pitch` long between two of them, with a detour where need be.

    The detour goes on in the direction from which the line comes, so that it is the corner of a bent strip.
    Steps that are shorter by a share of up to `tolerance` have none.
    """
    moves = np.diff(points, axis=0)
    lengths = np.linalg.norm(moves, axis=1)
    moved = np.flatnonzero(lengths > 0.0)
    towards = moves[moved[0]] / lengths[moved[0]] if len(moved) else np.array([1.0, 0.0, 0.0])
    nodes = [points[0]]
    for point, move, length in zip(points, moves, lengths, strict=False):
        if length < pitch * (1 - tolerance):
            ahead = (pitch**2 - length**2) / (2.0 * (pitch - float(move @ towards)))
            nodes.append(point + ahead * towards)
        nodes.append(point + move)
        if length > 0.0:
            last = nodes[-1] - nodes[-2]
            towards = last / np.linalg.norm(last)
    line = np.array(nodes)
    if len(line) < 1.5 * len(points):  # otherwise there is a detour nearly everywhere
        along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
        line = line[_vertices(along, line, min(EVEN / 10 * pitch, MAX_OFFSET_M / 10))]
    return _with_ends(line, pitch)


def _with_ends(vertices: Array, step: float) -> Array:
    """Return the line through `vertices`, half a `step` longer at both ends."""
    moves = np.diff(vertices, axis=0)
    moves = moves[np.linalg.norm(moves, axis=1) > 0.0]
    ends = (moves[0], moves[-1]) if len(moves) else (np.array([1.0, 0.0, 0.0]),) * 2
    before, behind = (end / np.linalg.norm(end) * step / 2 for end in ends)
    inner = vertices if len(moves) else vertices[:0]
    return np.vstack([vertices[0] - before, *inner[1:-1], vertices[-1] + behind])


def _vertices(at: Array, points: Array, limit: float) -> list[int]:
    """Return the indices of points between which all others are within `limit` of where `at` has them.

    Douglas-Peucker, with the position along the line in place of the nearest one. All are returned if there
    would be many.
    """
    vertices = {0, len(points) - 1}
    stack = [(0, len(points) - 1)]
    while stack:
        low, high = stack.pop()
        if high - low < 2:
            continue
        share = (at[low + 1 : high] - at[low]) / (at[high] - at[low])
        apart = np.linalg.norm(
            points[low + 1 : high] - points[low] - share[:, None] * (points[high] - points[low]), axis=1
        )
        worst = int(np.argmax(apart))
        if apart[worst] > limit:
            if len(vertices) > len(points) // 8 + 8:
                return list(range(len(points)))
            corner = low + 1 + worst
            vertices.add(corner)
            stack += [(low, corner), (corner, high)]
    return sorted(vertices)


def no_note(_: str) -> None:
    """Ignore a sentence."""


def named_strips(
    found: Iterable[tuple[str, int, FittedStrip]], names: Container[str], on_note: Note = no_note
) -> dict[str, StripEntry]:
    """Return entries of strips, given by name (`""`: none), number of the first pixel, and line."""
    found = list(found)
    if len(found) > MAX_STRIPS:
        raise ConfigError(
            f"gives {len(found)} strips, limit {MAX_STRIPS}; set gap to the longest step within a strip, or "
            "split the file"
        )
    strips: dict[str, StripEntry] = {}
    end = 0
    for name, first, each in found:
        plain = valid_name(name)
        is_free = name and name == plain and name not in strips
        key = name if is_free else free_name(plain or f"strip_{len(strips) + 1}", strips, names)
        if name != plain:
            on_note(f"strip {format_value(name)} is called {key}, a name that a map can have")
        line = [[round(float(value), 6) for value in vertex] for vertex in each.line]
        strips[key] = strip_entry(line, each.pixels, None if first == end else first)
        end = first + each.pixels
    return strips


def strip_entry(line: Sequence[Sequence[float]], pixels: int, offset: int | None = None) -> StripEntry:
    """Return a strip. Raises ConfigError if no map can have it."""
    try:
        return StripEntry.model_validate({"line": line, "pixels": pixels, "offset": offset})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"a strip of {pixels} pixels: {where}: {describe_mistake(first)}") from None


def free_name(name: str, *taken: Container[str]) -> str:
    """Return `name`, with a number if one of `taken` has it."""

    def is_free(key: str) -> bool:
        return not any(key in each for each in taken)

    return name if is_free(name) else next(filter(is_free, (f"{name[:60]}_{number}" for number in count(2))))
