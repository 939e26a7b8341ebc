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
    firsts = first_pixels(strips)
    for first, name in sorted((first, name) for name, first in firsts.items()):
        if first > end:
            yield end, first - 1
        end = max(end, first + strips[name].pixels)


def shared_pixels(strips: Mapping[str, StripEntry]) -> Iterator[tuple[str, str]]:
    """Yield pairs of strips with common pixels of the wire, the later one first.

    There are none unless a strip has an offset.
    """
    if all(strip.offset is None for strip in strips.values()):
        return
    spans: list[tuple[int, int, str]] = []
    for name, first in first_pixels(strips).items():
        spans.append((first, first + strips[name].pixels, name))

    # By their first pixels, each is compared with the strip before that reaches farthest
    spans.sort()
    _, farthest_end, farthest_name = spans[0]
    for first, end, name in spans[1:]:
        if first < farthest_end:
            yield name, farthest_name
        if end > farthest_end:
            farthest_end = end
            farthest_name = name


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
    is_last = (np.diff(numbers) != 1) | (steps > gap_m)
    starts = np.flatnonzero(is_last) + 1
    for start, stop in pairwise([0, *starts.tolist(), len(points)]):
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
    if not step:
        return
    longest = float(steps.max())
    if longest > MAX_SLACK * step:
        index = int(np.argmax(steps))
        raise ConfigError(
            f"pixels {index} and {index + 1} are {longest:.3g} m apart, and others {step:.3g} m; name strips "
            f"in a column strip, or set gap to the longest step within a strip, such as {2.0 * step:.3g}"
        )


def pixels_along(line: Array, pixels: int) -> Array:
    """Return the positions of a strip's pixels from the line's first vertex on, n x 3, m."""
    polyline = Polyline(line.tolist())
    positions_m = (np.arange(pixels) + 0.5) * polyline.length_m / pixels
    return polyline.points_at(positions_m)


def median_step(steps: Array) -> float:
    """Return the median of the steps that are not zero, 0 if all are."""
    positive_steps = steps[steps > 0.0]
    return float(np.median(positive_steps)) if len(positive_steps) else 0.0


def _fitted_line(points: Array, usual: float) -> Array:
    """Return the line along which `points` are even; `usual` is the step where there is none."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    step = median_step(steps) or usual
    limit = min(MAX_OFFSET * min(step, usual), MAX_OFFSET_M)

    # Pixels with one pitch but for some bends
    even_steps = steps[np.abs(steps - step) <= EVEN * step]
    if len(even_steps) >= (1 - MAX_BENDS) * len(steps):
        pitch = float(even_steps.mean()) if len(even_steps) else step
        line = _bent(points, pitch, EVEN)
        if _max_offset(line, points) <= limit:
            return line

    # Else pixels that are evenly along the line through corners, or all of them with detours
    line = _smooth(points, step, limit)
    if _max_offset(line, points) <= limit:
        return line
    return _bent(points, float(steps.max()) or usual, 1e-6)


def _max_offset(line: Array, points: Array) -> float:
    """Return the largest distance of a pixel along `line` from that of `points`, m."""
    offsets = pixels_along(line, len(points)) - points
    return float(np.linalg.norm(offsets, axis=1).max())


def _smooth(points: Array, step: float, limit: float) -> Array:
    """Return the line through the corners of evenly spaced pixels."""
    vertices = _vertices(np.arange(len(points), dtype=np.float64), points, limit)
    return _with_ends(points[vertices], step)


def _bent(points: Array, pitch: float, tolerance: float) -> Array:
    """Return the line through all pixels, `pitch` long between two of them, with a detour where need be.

    The detour goes on in the direction from which the line comes, so that it is the corner of a bent strip.
    Steps that are shorter by a share of up to `tolerance` have none.
    """
    # Direction from which the line comes, at first that of the first step
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    positive = np.flatnonzero(lengths > 0.0)
    towards = np.array([1.0, 0.0, 0.0])
    if len(positive):
        towards = steps[positive[0]] / lengths[positive[0]]

    # A detour goes ahead so far that its two legs are as long as the pitch (law of cosines)
    nodes = [points[0]]
    for point, step, length in zip(points, steps, lengths, strict=False):
        if length < pitch * (1 - tolerance):
            step_ahead = float(step @ towards)
            square = pitch**2 - length**2
            ahead = square / (2.0 * (pitch - step_ahead))
            nodes.append(point + ahead * towards)
        nodes.append(point + step)
        if length > 0.0:
            last_leg = nodes[-1] - nodes[-2]
            towards = last_leg / np.linalg.norm(last_leg)
    line = np.array(nodes)

    # Straight stretches need their ends only, unless there is a detour nearly everywhere
    if len(line) < 1.5 * len(points):
        legs = np.linalg.norm(np.diff(line, axis=0), axis=1)
        along = np.r_[0.0, np.cumsum(legs)]
        limit = min(EVEN / 10 * pitch, MAX_OFFSET_M / 10)
        line = line[_vertices(along, line, limit)]
    return _with_ends(line, pitch)


def _with_ends(vertices: Array, step: float) -> Array:
    """Return the line through `vertices`, half a `step` longer at both ends."""
    steps = np.diff(vertices, axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > 0.0]
    first_step = last_step = np.array([1.0, 0.0, 0.0])
    inner = vertices[:0]
    if len(steps):
        first_step = steps[0]
        last_step = steps[-1]
        inner = vertices[1:-1]
    before = first_step / np.linalg.norm(first_step) * step / 2
    behind = last_step / np.linalg.norm(last_step) * step / 2
    start = vertices[0] - before
    end = vertices[-1] + behind
    return np.vstack([start, *inner, end])


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

        # The worst of the points between becomes a vertex, if it is too far off. Points that are all in one
        # place have no shares, and need none.
        between = slice(low + 1, high)
        shares = (at[between] - at[low]) / (at[high] - at[low])
        chord = points[high] - points[low]
        offsets = points[between] - points[low] - shares[:, None] * chord
        distances = np.linalg.norm(offsets, axis=1)
        worst = int(np.argmax(distances))
        if distances[worst] > limit:
            if len(vertices) > len(points) // 8 + 8:
                return list(range(len(points)))
            corner = low + 1 + worst
            vertices.add(corner)
            stack += [(low, corner), (corner, high)]
    return sorted(vertices)


def no_note(_: str) -> None:
    """Ignore a sentence."""


def named_strips(
    fitted: Iterable[tuple[str, int, FittedStrip]], names: Container[str], on_note: Note = no_note
) -> dict[str, StripEntry]:
    """Return entries of strips, given by name (`""`: none), number of the first pixel, and line."""
    fitted = list(fitted)
    if len(fitted) > MAX_STRIPS:
        raise ConfigError(
            f"gives {len(fitted)} strips, limit {MAX_STRIPS}; set gap to the longest step within a strip, or "
            "split the file"
        )
    strips: dict[str, StripEntry] = {}
    end = 0
    for name, first, strip in fitted:
        # The name of the file, or one like it that neither the file nor the map has
        plain = valid_name(name)
        key = name
        if not name or name != plain or name in strips:
            key = free_name(plain or f"strip_{len(strips) + 1}", strips, names)
        if name != plain:
            on_note(f"strip {format_value(name)} is called {key}, a name that a map can have")

        # Without an offset, it goes on where the strip before ends
        line: list[list[float]] = []
        for vertex in strip.line.tolist():
            line.append([round(value, 6) for value in vertex])
        strips[key] = strip_entry(line, strip.pixels, None if first == end else first)
        end = first + strip.pixels
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
    candidate = name
    for number in count(2):
        if not any(candidate in names for names in taken):
            break
        candidate = f"{name[:60]}_{number}"
    return candidate
