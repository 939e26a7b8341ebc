"""Renders segments and cursors to pixels (paper, §III-E), which are laid out along each line once per map.

Every pixel belongs to its own strip, and to each belt beside which it lies: within half the belt's width and
`BESIDE_BELT_M` of its centre line, not beyond its ends, at the nearest arc length. For each line the pixels
of all strips are sorted by arc length. Curves, gaps, reversed strips, strips on both sides and clipping are
all reduced to the position of an arc length in that order.

An object is a segment in the colour of its kind, dim, or bright if selected. Its margins have the colour of
the person who hovers or has selected it, alternating by pixel if there are several colours. The body changes
from both ends to the middle with the progress of selection. Dark pixels in the body of a selected object
form the owner's pattern. Cursors are drawn on top, alternating by pixel where several overlap.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array, Indices
from pointit.geometry.polyline import Polyline
from pointit.schemas import Belt, Strip
from pointit.schemas.base import Rgb
from pointit.schemas.environment import BESIDE_BELT_M
from pointit.services.led_driver.config import StyleConfig

Bytes = NDArray[np.uint8]

END_M = 1e-3
"""Distance beyond a belt's end at which a pixel still belongs to it, the accuracy of maps."""
MAX_PIXELS = 64 * 4096
"""Limit of the pixels of all strips. A larger frame would exceed the size of its message."""
_ROUNDING = 1e-6
"""Tolerance beyond an end of a strip, pixels."""
_APART_M = 1.0
"""Gap between lines on the axis on which all lie one after the other. Look-ups reach no further."""
PATTERNS = ("solid", "dashed", "dotted", "striped", "hollow", "tailed")
"""Patterns of the profile. A segment has the index."""
_DASHED, _DOTTED, _STRIPED, _HOLLOW, _TAILED = range(1, 6)
BODY, FILL, GAP, OWNER, MARGIN = range(5)
"""Roles of pixels: body, its other level by the gauge, dark of patterns, owner's colour, margins."""
MARGIN_COLORS = 4
"""Maximum number of alternating colours."""
ROLES = MARGIN + MARGIN_COLORS
MAX_TAIL_M = 0.5
"""Maximum length of a moving object's tail, m."""
_ROUNDING_M = 1e-9
"""Distance beyond an object's end at which a pixel is still on it."""
_MANY = 1e9
"""Limit of the count of pixels."""


@dataclass(frozen=True, slots=True)
class _Run:
    """Pixels of one strip along one line without a gap, sorted by arc length."""

    pixels: Indices
    at_m: Array
    pitch_m: float
    """Mean distance from pixel to pixel along the line."""
    coarsest_m: float
    """Maximum of that distance."""
    from_m: Array
    to_m: Array
    """Interval nearer to this pixel than to its neighbours."""


class Layout:
    """All pixels of a map one after the other, and the lines along which they lie.

    Attributes:
        count: number of pixels of all strips.
        slices: slice of each strip's bytes in a frame, by id.
        wire: number of every pixel on its own strip's wire.
        at_m, pixels, run, number: arc length, pixel, run, and number in the run of every entry (a pixel on a
            line). A run is pixels of one strip along one line without a gap. Entries are sorted by line and
            arc length.
        pitch_m, first_m, last_m, pixels_of: distance from pixel to pixel along the line, arc lengths of the
            first and last pixel, and number of pixels of every run.
    """

    def __init__(self, strips: Sequence[Strip], belts: Sequence[Belt] = ()) -> None:
        """Arrange `strips` one after the other, and find the pixels beside `belts`.

        Raises:
            ValueError: If a line has no length, or there are more pixels than a frame can hold.
        """
        self.count = sum(strip.pixels for strip in strips)
        if self.count > MAX_PIXELS:
            raise ValueError(f"all have {self.count} pixels together, a frame holds {MAX_PIXELS}")
        own: list[tuple[_Run, Array]] = []
        self.slices: dict[str, slice] = {}
        first = 0
        for strip in strips:
            self.slices[strip.id] = slice(3 * first, 3 * (first + strip.pixels))
            own.append(_own_run(strip, first))
            first += strip.pixels
        self.wire: Indices = _joined([np.arange(strip.pixels) for strip in strips]).astype(np.intp)
        runs = [[run] for run, _ in own]
        lengths_m = [Polyline(strip.line_m).length_m for strip in strips]
        self._lines = {("strip", strip.id): number for number, strip in enumerate(strips)}
        for belt in belts:
            line = Polyline(belt.line_m)
            self._lines["belt", belt.id] = len(runs)
            runs.append(list(_runs_beside(line, belt.width_m / 2.0 + BESIDE_BELT_M, own)))
            lengths_m.append(line.length_m)
        self._lay(runs, np.array(lengths_m))

    def _lay(self, lines: list[list[_Run]], lengths_m: Array) -> None:
        self._ends_m = lengths_m + _APART_M / 4.0
        self._origins_m = np.cumsum(lengths_m + _APART_M) - lengths_m
        runs = [run for line in lines for run in line]
        line_of_run = [number for number, line in enumerate(lines) for _ in line]
        sizes = [len(run.pixels) for run in runs]
        line = np.repeat(np.array(line_of_run, dtype=np.intp), sizes)
        at_m = _joined([run.at_m for run in runs])
        order = np.lexsort((at_m, line))
        self.at_m: Array = at_m[order]
        self.pixels: Indices = _joined([run.pixels for run in runs]).astype(np.intp)[order]
        self.run: Indices = np.repeat(np.arange(len(runs)), sizes)[order]
        self.number: Indices = _joined([np.arange(size) for size in sizes]).astype(np.intp)[order]
        self.pitch_m: Array = np.array([run.pitch_m for run in runs])
        self.first_m: Array = np.array([run.at_m[0] for run in runs])
        self.last_m: Array = np.array([run.at_m[-1] for run in runs])
        self.pixels_of: Indices = np.array(sizes, dtype=np.intp)
        self._lay_runs(runs, np.array(line_of_run, dtype=np.intp), order)
        self._keys: Array = self._origins_m[line[order]] + self.at_m if len(line) else at_m
        self._coarsest_m: Array = np.array(
            [max((run.coarsest_m for run in line), default=0.0) for line in lines]
        )

    def line(self, surface: str, line_id: str) -> int | None:
        """Return the number of the strip or belt `line_id`, or None if the map has no such line."""
        return self._lines.get((surface, line_id))

    def narrow(self, lines: Indices, lengths_m: Array) -> NDArray[np.bool_]:
        """Return True for each object on `lines` (numbers), `lengths_m` long, that may miss all pixels."""
        return lengths_m < self._coarsest_m[lines]

    def lit(self, lines: Indices, start_m: Array, end_m: Array) -> tuple[Indices, Indices]:
        """Return the entries in [start_m, end_m] of `lines` (numbers).

        Returns:
            Span index and entry of each pair, sorted by span. A span that is shorter than a pixel has the
            pixel that contains it, for every strip.
        """
        if not len(self._keys):
            return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
        origin_m = self._origins_m[lines]
        limit_m = self._ends_m[lines]
        low = origin_m + np.minimum(np.maximum(start_m, -_APART_M / 4.0), limit_m)
        high = origin_m + np.minimum(np.maximum(end_m, -_APART_M / 4.0), limit_m)
        first = self._keys.searchsorted(low, side="left")
        counts = self._keys.searchsorted(high, side="right") - first
        (narrow,) = (end_m - start_m < self._coarsest_m[lines]).nonzero()
        counts[narrow] = 0
        ends = counts.cumsum()
        spans = np.arange(len(counts)).repeat(counts)
        entries = np.arange(len(spans)) - (ends - counts - first).repeat(counts)
        if not len(narrow):
            return spans, entries
        line_of_entry, those = self._lit_run_by_run(lines[narrow], start_m[narrow], end_m[narrow])
        spans = np.concatenate([spans, narrow[line_of_entry]])
        entries = np.concatenate([entries, those])
        order = np.argsort(spans, kind="stable")
        return spans[order], entries[order]

    def _lit_run_by_run(self, lines: Indices, start_m: Array, end_m: Array) -> tuple[Indices, Indices]:
        """Return the same as `lit`: the entries in each span, or else for each run the one at its middle."""
        line_of_entry, run = _expanded(self._runs_bounds[lines], self._runs_bounds[lines + 1])
        start_m = start_m[line_of_entry]
        end_m = end_m[line_of_entry]
        low = self._rows(self._run_at_m, run, start_m, bisect_left)
        high = self._rows(self._run_at_m, run, end_m, bisect_right)
        middle_m = (start_m + end_m) / 2.0
        about = self._rows(self._run_from_list_m, run, middle_m, bisect_right) - 1
        about = np.minimum(np.maximum(about, self._run_bounds[run]), self._run_bounds[run + 1] - 1)
        is_there = (self._run_from_m[about] <= middle_m) & (middle_m < self._run_to_m[about])
        is_about = (low >= high) & is_there
        low, high = np.where(is_about, about, low), np.where(is_about, about + 1, np.maximum(low, high))
        pairs, rows = _expanded(low, high)
        return line_of_entry[pairs], self._entry_of[rows]

    def _rows(self, values_m: list[float], run: Indices, at_m: Array, search: Callable[..., int]) -> Indices:
        """Return the positions of `at_m` in `values_m`, sorted within each run: few, so without arrays."""
        bounds = self._run_bounds
        pairs = zip(at_m.tolist(), bounds[run].tolist(), bounds[run + 1].tolist(), strict=True)
        rows = [search(values_m, each_m, low, high) for each_m, low, high in pairs]
        return np.array(rows, dtype=np.intp)

    def _lay_runs(self, runs: list[_Run], line_of_run: Indices, order: Indices) -> None:
        """Store the entries by run too, to look up spans shorter than a pixel."""
        lines = len(self._ends_m)
        self._runs_bounds: Indices = np.searchsorted(line_of_run, np.arange(lines + 1))
        """First run of each line."""
        self._run_bounds: Indices = np.r_[0, np.cumsum([len(run.pixels) for run in runs])].astype(np.intp)
        """First row of each run."""
        self._run_at_m: list[float] = _joined([run.at_m for run in runs]).tolist()
        self._run_from_m: Array = _joined([run.from_m for run in runs])
        self._run_from_list_m: list[float] = self._run_from_m.tolist()
        self._run_to_m: Array = _joined([run.to_m for run in runs])
        self._entry_of: Indices = np.argsort(order)
        """The entry of each row."""


def _expanded(first: Indices, end: Indices) -> tuple[Indices, Indices]:
    """Return every number from `first` up to `end`, preceded by the index of its pair."""
    counts = end - first
    line_of_entry = np.repeat(np.arange(len(counts)), counts)
    return line_of_entry, np.arange(len(line_of_entry)) - np.repeat(
        np.cumsum(counts) - counts - first, counts
    )


def _own_run(strip: Strip, first: int) -> tuple[_Run, Array]:
    line = Polyline(strip.line_m)
    numbers: Array = np.arange(strip.pixels + 1, dtype=np.float64)
    bounds_m: Array = numbers / (strip.pixels / line.length_m)
    at_m: Array = (numbers[:-1] + 0.5) / (strip.pixels / line.length_m)
    pixels = np.arange(first, first + strip.pixels)
    pitch_m = line.length_m / strip.pixels
    bounds_m[[0, -1]] += np.array([-1.0, 1.0]) * _ROUNDING * pitch_m
    run = _Run(
        pixels if strip.direction == 1 else pixels[::-1], at_m, pitch_m, pitch_m, bounds_m[:-1], bounds_m[1:]
    )
    return run, line.points_at(at_m)


def _runs_beside(line: Polyline, reach_m: float, strips: list[tuple[_Run, Array]]) -> Iterator[_Run]:
    low_m = line.vertices_m.min(axis=0) - reach_m
    high_m = line.vertices_m.max(axis=0) + reach_m
    for run, places_m in strips:
        near = np.flatnonzero(np.all((places_m >= low_m) & (places_m <= high_m), axis=1))
        at_m, apart_m = line.nearest_to(places_m[near])
        beside = (apart_m <= reach_m) & ~line.is_beyond_ends(places_m[near], at_m, END_M)
        order = np.argsort(at_m[beside], kind="stable")
        pixels = run.pixels[near[beside][order]]
        along_m = at_m[beside][order]
        gaps = np.flatnonzero(np.diff(along_m) > 2.0 * run.pitch_m) + 1
        for part, part_m in zip(np.split(pixels, gaps), np.split(along_m, gaps), strict=True):
            if len(part):
                yield _run_along(part, part_m, run.pitch_m)


def _run_along(pixels: Indices, at_m: Array, own_m: float) -> _Run:
    """Return the run of `pixels` at the sorted `at_m`; they are `own_m` apart along their own strip."""
    steps_m = np.diff(at_m)
    # at sharp corners and where a strip goes across, many pixels share one arc length
    pitch_m = max(float(steps_m.mean()), own_m / 4.0) if len(steps_m) else own_m
    half_m = pitch_m * (0.5 + _ROUNDING)
    middle_m = at_m[:-1] + steps_m / 2.0
    from_m = np.r_[at_m[0] - half_m, middle_m]
    to_m = np.r_[middle_m, at_m[-1] + half_m]
    return _Run(pixels, at_m, pitch_m, max(float(steps_m.max(initial=0.0)), pitch_m), from_m, to_m)


def _joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return np.concatenate(parts) if parts else np.zeros(0)


@dataclass(frozen=True, slots=True)
class Segments:
    """Objects to draw, n of them, each centred on `at_m` of a line of the layout. Later ones are on top."""

    lines: Indices
    at_m: Array
    half_m: Array
    forth: NDArray[np.bool_]
    """True if it moves from the line's start to its end, or stands."""
    tail_m: tuple[Array, Array] | None
    """Lengths of the tails before the starts and after the ends, or None if nothing moves."""
    palette: Bytes
    """Colours, n x `ROLES` x 3."""
    progress: Array
    """Filled share of the body, 0 to 1."""
    margins: Indices
    """Number of colours of the margins, 0 without margins."""
    thin: NDArray[np.bool_]
    """True for margins of one pixel only."""
    patterns: Indices
    """Index into `PATTERNS`."""


class CursorMark(NamedTuple):
    """A cursor to draw."""

    line: int
    at_m: float
    width_m: float
    color: Rgb


def tails(
    layout: Layout, lines: Indices, half_m: Array, speed_mps: Array, style: StyleConfig
) -> tuple[Array, Array] | None:
    """Return the tails of objects for `Segments`. Objects that may fit between two pixels have none."""
    length_m = np.minimum(np.abs(speed_mps) * style.tail_s, MAX_TAIL_M)
    length_m[layout.narrow(lines, 2.0 * half_m)] = 0.0
    if not length_m.any():
        return None
    return np.where(speed_mps > 0.0, length_m, 0.0), np.where(speed_mps < 0.0, length_m, 0.0)


class Renderer:
    """Draws frames on one layout. All strips share one buffer, so that each operation covers all of them."""

    def __init__(self, layout: Layout, style: StyleConfig | None = None) -> None:
        self._style = style if style is not None else StyleConfig()
        self.layout = layout
        self._buffer: Bytes = np.zeros((layout.count, 3), dtype=np.uint8)
        margin = np.clip(np.rint(self._style.margin_m / layout.pitch_m), 1, 4096).astype(np.intp)
        self._margin: Indices = margin[layout.run]
        """Number of pixels of a margin, for every entry of the layout."""

    def render(self, segments: Segments, cursors: list[CursorMark]) -> Bytes:
        """Return all pixels (n x 3, red green blue) in the layout's order, valid until the next call."""
        self._buffer.fill(0)
        if len(segments.lines):
            self._draw_segments(segments)
        if cursors:
            self._draw_cursors(cursors)
        return self._buffer

    def _draw_segments(self, segments: Segments) -> None:
        layout = self.layout
        start_m = segments.at_m - segments.half_m
        end_m = segments.at_m + segments.half_m
        tails_m = segments.tail_m
        if tails_m is None:
            line_of_entry, entries = layout.lit(segments.lines, start_m, end_m)
        else:
            line_of_entry, entries = layout.lit(segments.lines, start_m - tails_m[0], end_m + tails_m[1])
        if not len(entries):
            return
        at_m = layout.at_m[entries]
        before_m = at_m - start_m[line_of_entry]
        after_m = end_m[line_of_entry] - at_m
        if tails_m is not None:
            tail_m = tails_m[0] + tails_m[1]
            outside_m = np.minimum(before_m, after_m)
            behind = (outside_m < -_ROUNDING_M) & (tail_m > 0.0)[line_of_entry]
            tail = np.flatnonzero(behind)
            if len(tail):
                fade = self._style.tail_level * (1.0 + outside_m[tail] / tail_m[line_of_entry[tail]])
                colors = segments.palette[line_of_entry[tail], BODY] * np.maximum(fade, 0.0)[:, None]
                self._buffer[layout.pixels[entries[tail]]] = colors
                body = np.flatnonzero(~behind)
                line_of_entry = line_of_entry[body]
                entries = entries[body]
                before_m = before_m[body]
                after_m = after_m[body]
        roles = np.zeros(len(line_of_entry), dtype=np.intp)
        stated = np.flatnonzero((segments.margins > 0)[line_of_entry])
        if len(stated):
            those = line_of_entry[stated]
            these = entries[stated]
            first, last = self._counted(segments, those, these, start_m, end_m)
            roles[stated] = self._roles(segments, those, self._margin[these], first, last)
        self._buffer[layout.pixels[entries]] = segments.palette[line_of_entry, roles]

    def _counted(
        self, segments: Segments, line_of_entry: Indices, entries: Indices, start_m: Array, end_m: Array
    ) -> tuple[Indices, Indices]:
        """Return for each pixel the numbers of its segment's pixels before and after it on the same strip.

        If the strip ends within the segment, pixels are counted as if it continued.
        """
        layout = self.layout
        run = layout.run[entries]
        number = layout.number[entries]
        stated = np.cumsum(segments.margins > 0) - 1
        slot = stated[line_of_entry] * len(layout.pitch_m) + run
        low = np.full((int(stated[-1]) + 1) * len(layout.pitch_m), layout.count, dtype=np.intp)
        high = np.zeros_like(low)
        np.minimum.at(low, slot, number)
        np.maximum.at(high, slot, number)
        low = low[slot]
        high = high[slot]
        pitch_m = layout.pitch_m[run]
        before = _whole((layout.first_m[run] - start_m[line_of_entry]) / pitch_m) * (low == 0)
        after = _whole((end_m[line_of_entry] - layout.last_m[run]) / pitch_m) * (
            high == layout.pixels_of[run] - 1
        )
        return number - low + before, high - number + after

    @staticmethod
    def _roles(
        segments: Segments, line_of_entry: Indices, widest: Indices, first: Indices, last: Indices
    ) -> Indices:
        """Return the role of each pixel: the `first`-th from its segment's start, `last`-th from the end."""
        nearer = np.minimum(first, last)
        count = first + last + 1
        roles = np.zeros(len(line_of_entry), dtype=np.intp)
        roles[nearer < np.rint(segments.progress[line_of_entry] * count / 2.0)] = FILL
        margin = np.minimum(widest, count // 3)
        patterns = segments.patterns[line_of_entry]
        if patterns.any():
            trailing = np.where(segments.forth[line_of_entry], first, last)
            _draw_patterns(
                roles,
                patterns,
                inward=nearer - margin,
                along=first - margin,
                trailing=trailing - margin,
                body=count - 2 * margin,
            )
        margin = np.where(segments.thin[line_of_entry], np.minimum(margin, 1), margin)
        colors = segments.margins[line_of_entry]
        # each end begins with another colour if there are more colours than pixels
        turn = (nearer + (last < first) * np.maximum(colors - margin, 0)) % np.maximum(colors, 1)
        ends = nearer < margin
        roles[ends] = MARGIN + turn[ends]
        return roles

    def _draw_cursors(self, cursors: list[CursorMark]) -> None:
        layout = self.layout
        line, place_m, width_m, color = zip(*cursors, strict=True)
        lines = np.array(line, dtype=np.intp)
        colors = np.array(color, dtype=np.uint8)
        at_m = np.array(place_m)
        half_m = np.array(width_m) / 2.0
        line_of_entry, entries = layout.lit(lines, at_m - half_m, at_m + half_m)
        pixels = layout.pixels[entries]
        if len(cursors) > 1 and len(pixels):
            # the k-th cursor over a pixel shows if k is the pixel's number modulo the number of cursors
            order = np.lexsort((line_of_entry, pixels))
            pixels = pixels[order]
            line_of_entry = line_of_entry[order]
            begins = np.ones(len(pixels), dtype=np.bool_)
            np.not_equal(pixels[1:], pixels[:-1], out=begins[1:])
            group = np.cumsum(begins) - 1
            rank = np.arange(len(pixels)) - np.flatnonzero(begins)[group]
            shown = rank == layout.wire[pixels] % np.bincount(group)[group]
            pixels = pixels[shown]
            line_of_entry = line_of_entry[shown]
        self._buffer[pixels] = colors[line_of_entry]


def _whole(pixels: Array) -> Indices:
    return np.minimum(np.maximum(pixels + _ROUNDING, 0.0), _MANY).astype(np.intp)


def _draw_patterns(
    roles: Indices, patterns: Indices, *, inward: Indices, along: Indices, trailing: Indices, body: Indices
) -> None:
    """Set the roles of the pixels of a pattern.

    Args:
        roles: roles to change.
        patterns: pattern of the segment of each pixel.
        inward: pixels from the nearer end of the body, from 0 on. Negative in the margins.
        along: pixels from the start of the body.
        trailing: pixels from the trailing end of the body.
        body: number of pixels of the body. Below three no pattern is visible.
    """
    patterns = np.where((inward >= 0) & (body >= 3), patterns, 0)
    roles[(patterns == _DASHED) & (inward % 4 == 0)] = GAP
    roles[(patterns == _DOTTED) & (along % 2 == 1)] = GAP
    roles[(patterns == _HOLLOW) & (inward >= 1)] = GAP
    roles[(patterns == _STRIPED) & (along % 2 == 1)] = OWNER
    roles[(patterns == _TAILED) & (trailing < body // 2)] = OWNER
