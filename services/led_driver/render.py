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

        # Pixels of each strip along its own line
        strip_runs: list[tuple[_Run, Array]] = []
        self.slices: dict[str, slice] = {}
        first = 0
        for strip in strips:
            end = first + strip.pixels
            self.slices[strip.id] = slice(3 * first, 3 * end)
            strip_runs.append(_own_run(strip, first))
            first = end
        self.wire: Indices = _counted_up([strip.pixels for strip in strips])

        # Lines are the strips, then the belts with the pixels beside them
        runs = [[run] for run, _ in strip_runs]
        lengths_m = [Polyline(strip.line_m).length_m for strip in strips]
        self._lines = {("strip", strip.id): number for number, strip in enumerate(strips)}
        for belt in belts:
            line = Polyline(belt.line_m)
            reach_m = belt.width_m / 2.0 + BESIDE_BELT_M
            self._lines["belt", belt.id] = len(runs)
            runs.append(list(_runs_beside(line, reach_m, strip_runs)))
            lengths_m.append(line.length_m)
        self._store_entries(runs, np.array(lengths_m))

    def _store_entries(self, lines: list[list[_Run]], lengths_m: Array) -> None:
        """Store the pixels of all `lines`, given as runs, sorted by line and arc length."""
        # All lines lie one after the other on an axis, so that one sorted search serves them all
        self._ends_m = lengths_m + _APART_M / 4.0
        self._origins_m = np.cumsum(lengths_m + _APART_M) - lengths_m
        runs: list[_Run] = []
        line_of_run: list[int] = []
        coarsest_m: list[float] = []
        for number, line_runs in enumerate(lines):
            runs += line_runs
            line_of_run += [number] * len(line_runs)
            coarsest_m.append(max((run.coarsest_m for run in line_runs), default=0.0))

        # The fields of every entry
        sizes = [len(run.pixels) for run in runs]
        line = np.repeat(np.array(line_of_run, dtype=np.intp), sizes)
        at_m = _joined([run.at_m for run in runs])
        order = np.lexsort((at_m, line))
        self.at_m: Array = at_m[order]
        pixels = _joined([run.pixels for run in runs]).astype(np.intp)
        self.pixels: Indices = pixels[order]
        run_of_entry = np.repeat(np.arange(len(runs)), sizes)
        self.run: Indices = run_of_entry[order]
        self.number: Indices = _counted_up(sizes)[order]

        # Those of every run
        self.pitch_m: Array = np.array([run.pitch_m for run in runs])
        self.first_m: Array = np.array([run.at_m[0] for run in runs])
        self.last_m: Array = np.array([run.at_m[-1] for run in runs])
        self.pixels_of: Indices = np.array(sizes, dtype=np.intp)
        self._store_runs(runs, np.array(line_of_run, dtype=np.intp), order)

        # Positions of the entries on the common axis, and the largest gap between pixels of each line
        sorted_line = line[order]
        self._keys: Array = self._origins_m[sorted_line] + self.at_m if len(line) else at_m
        self._coarsest_m: Array = np.array(coarsest_m)

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

        # The entries of a span are consecutive on the common axis
        origin_m = self._origins_m[lines]
        limit_m = self._ends_m[lines]
        before_m = -_APART_M / 4.0
        low = origin_m + np.minimum(np.maximum(start_m, before_m), limit_m)
        high = origin_m + np.minimum(np.maximum(end_m, before_m), limit_m)
        first = self._keys.searchsorted(low, side="left")
        counts = self._keys.searchsorted(high, side="right") - first

        # Narrow spans, which may lie between two pixels, are looked up below
        (narrow,) = (end_m - start_m < self._coarsest_m[lines]).nonzero()
        counts[narrow] = 0
        ends = counts.cumsum()
        offsets = ends - counts - first
        spans = np.arange(len(counts)).repeat(counts)
        entries = np.arange(len(spans)) - offsets.repeat(counts)
        if not len(narrow):
            return spans, entries

        # Each strip shows them by the pixel that contains their middle
        pairs, narrow_entries = self._lit_run_by_run(lines[narrow], start_m[narrow], end_m[narrow])
        spans = np.concatenate([spans, narrow[pairs]])
        entries = np.concatenate([entries, narrow_entries])
        order = np.argsort(spans, kind="stable")
        return spans[order], entries[order]

    def _lit_run_by_run(self, lines: Indices, start_m: Array, end_m: Array) -> tuple[Indices, Indices]:
        """Return the same as `lit`: the entries in each span, or else for each run the one at its middle."""
        # Pairs of a span and a run of its line
        first_run = self._runs_bounds[lines]
        end_run = self._runs_bounds[lines + 1]
        span_of_pair, run = _expanded(first_run, end_run)
        start_m = start_m[span_of_pair]
        end_m = end_m[span_of_pair]
        low = self._rows(self._run_at_m, run, start_m, bisect_left)
        high = self._rows(self._run_at_m, run, end_m, bisect_right)

        # The pixel of the run whose interval contains the middle of the span, if any
        middle_m = (start_m + end_m) / 2.0
        nearest = self._rows(self._run_from_list_m, run, middle_m, bisect_right) - 1
        nearest = np.maximum(nearest, self._run_bounds[run])
        nearest = np.minimum(nearest, self._run_bounds[run + 1] - 1)
        is_behind_start = self._run_from_m[nearest] <= middle_m
        is_before_end = middle_m < self._run_to_m[nearest]

        # It stands for the span in runs of which the span contains no pixel
        is_between = (low >= high) & is_behind_start & is_before_end
        first = np.where(is_between, nearest, low)
        end = np.where(is_between, nearest + 1, np.maximum(low, high))
        pairs, rows = _expanded(first, end)
        return span_of_pair[pairs], self._entry_of[rows]

    def _rows(self, values_m: list[float], run: Indices, at_m: Array, search: Callable[..., int]) -> Indices:
        """Return the positions of `at_m` in `values_m`, sorted within each run: few, so without arrays."""
        bounds = self._run_bounds
        lows = bounds[run].tolist()
        highs = bounds[run + 1].tolist()
        queries = zip(at_m.tolist(), lows, highs, strict=True)
        rows = [search(values_m, query_m, low, high) for query_m, low, high in queries]
        return np.array(rows, dtype=np.intp)

    def _store_runs(self, runs: list[_Run], line_of_run: Indices, order: Indices) -> None:
        """Store the entries by run too, to look up spans shorter than a pixel."""
        lines = len(self._ends_m)
        self._runs_bounds: Indices = np.searchsorted(line_of_run, np.arange(lines + 1))
        """First run of each line."""
        ends = np.cumsum([len(run.pixels) for run in runs])
        self._run_bounds: Indices = np.r_[0, ends].astype(np.intp)
        """First row of each run."""
        run_at_m = _joined([run.at_m for run in runs])
        self._run_at_m: list[float] = run_at_m.tolist()
        self._run_from_m: Array = _joined([run.from_m for run in runs])
        self._run_from_list_m: list[float] = self._run_from_m.tolist()
        self._run_to_m: Array = _joined([run.to_m for run in runs])
        self._entry_of: Indices = np.argsort(order)
        """The entry of each row."""


def _expanded(first: Indices, end: Indices) -> tuple[Indices, Indices]:
    """Return every number from `first` up to `end`, preceded by the index of its pair."""
    counts = end - first
    pairs = np.repeat(np.arange(len(counts)), counts)
    offsets = np.cumsum(counts) - counts - first
    numbers = np.arange(len(pairs)) - np.repeat(offsets, counts)
    return pairs, numbers


def _own_run(strip: Strip, first: int) -> tuple[_Run, Array]:
    """Return the run of a strip along its own line, and the positions of its pixels, m, {W}."""
    line = Polyline(strip.line_m)
    numbers: Array = np.arange(strip.pixels + 1, dtype=np.float64)
    bounds_m: Array = numbers / (strip.pixels / line.length_m)
    middles: Array = numbers[:-1] + 0.5
    at_m: Array = middles / (strip.pixels / line.length_m)
    pixels = np.arange(first, first + strip.pixels)
    pitch_m = line.length_m / strip.pixels
    rounding_m = _ROUNDING * pitch_m
    bounds_m[0] -= rounding_m
    bounds_m[-1] += rounding_m
    if strip.direction != 1:
        pixels = pixels[::-1]
    run = _Run(
        pixels=pixels,
        at_m=at_m,
        pitch_m=pitch_m,
        coarsest_m=pitch_m,
        from_m=bounds_m[:-1],
        to_m=bounds_m[1:],
    )
    return run, line.points_at(at_m)


def _runs_beside(line: Polyline, reach_m: float, strips: list[tuple[_Run, Array]]) -> Iterator[_Run]:
    """Yield the runs of pixels of `strips` that lie within `reach_m` of `line`."""
    low_m = line.vertices_m.min(axis=0) - reach_m
    high_m = line.vertices_m.max(axis=0) + reach_m
    for run, positions_m in strips:
        # A box round the line leaves few pixels for the exact distance
        is_in_box = (positions_m >= low_m) & (positions_m <= high_m)
        near = np.flatnonzero(np.all(is_in_box, axis=1))
        at_m, distance_m = line.nearest_to(positions_m[near])
        is_beyond_ends = line.is_beyond_ends(positions_m[near], at_m, END_M)
        beside = (distance_m <= reach_m) & ~is_beyond_ends
        order = np.argsort(at_m[beside], kind="stable")
        pixels = run.pixels[near[beside][order]]
        along_m = at_m[beside][order]

        # Where the strip goes away from the line and comes back, the next run begins
        is_gap = np.diff(along_m) > 2.0 * run.pitch_m
        gaps = np.flatnonzero(is_gap) + 1
        parts = np.split(pixels, gaps)
        parts_m = np.split(along_m, gaps)
        for part, part_m in zip(parts, parts_m, strict=True):
            if len(part):
                yield _run_along(part, part_m, run.pitch_m)


def _run_along(pixels: Indices, at_m: Array, own_m: float) -> _Run:
    """Return the run of `pixels` at the sorted `at_m`; they are `own_m` apart along their own strip."""
    steps_m = np.diff(at_m)
    # at sharp corners and where a strip goes across, many pixels share one arc length
    pitch_m = own_m
    if len(steps_m):
        pitch_m = max(float(steps_m.mean()), own_m / 4.0)
    coarsest_m = max(float(steps_m.max(initial=0.0)), pitch_m)
    half_m = pitch_m * (0.5 + _ROUNDING)
    middle_m = at_m[:-1] + steps_m / 2.0
    from_m = np.r_[at_m[0] - half_m, middle_m]
    to_m = np.r_[middle_m, at_m[-1] + half_m]
    return _Run(pixels, at_m, pitch_m, coarsest_m, from_m, to_m)


def _counted_up(counts: Sequence[int]) -> Indices:
    """Return the numbers from 0 up to each of `counts`, one behind the other."""
    numbers = [np.arange(count) for count in counts]
    return _joined(numbers).astype(np.intp)


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
    behind_m = np.where(speed_mps > 0.0, length_m, 0.0)
    ahead_m = np.where(speed_mps < 0.0, length_m, 0.0)
    return behind_m, ahead_m


class Renderer:
    """Draws frames on one layout. All strips share one buffer, so that each operation covers all of them."""

    def __init__(self, layout: Layout, style: StyleConfig | None = None) -> None:
        self._style = style if style is not None else StyleConfig()
        self.layout = layout
        self._buffer: Bytes = np.zeros((layout.count, 3), dtype=np.uint8)
        margin = np.rint(self._style.margin_m / layout.pitch_m)
        margin_of_run = np.clip(margin, 1, 4096).astype(np.intp)
        self._margin: Indices = margin_of_run[layout.run]
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

        # Pixels of all segments with their tails
        tails_m = segments.tail_m
        if tails_m is None:
            segment_of_entry, entries = layout.lit(segments.lines, start_m, end_m)
        else:
            tail_start_m = start_m - tails_m[0]
            tail_end_m = end_m + tails_m[1]
            segment_of_entry, entries = layout.lit(segments.lines, tail_start_m, tail_end_m)
        if not len(entries):
            return

        # Tails fade with the distance from the body, and are drawn below all bodies
        if tails_m is not None:
            at_m = layout.at_m[entries]
            tail_m = tails_m[0] + tails_m[1]
            from_start_m = at_m - start_m[segment_of_entry]
            to_end_m = end_m[segment_of_entry] - at_m
            outside_m = np.minimum(from_start_m, to_end_m)
            behind = (outside_m < -_ROUNDING_M) & (tail_m > 0.0)[segment_of_entry]
            tail = np.flatnonzero(behind)
            if len(tail):
                place = outside_m[tail] / tail_m[segment_of_entry[tail]]  # 0 at the body, -1 at the end
                fade = self._style.tail_level * (1.0 + place)
                body_colors = segments.palette[segment_of_entry[tail], BODY]
                colors = body_colors * np.maximum(fade, 0.0)[:, None]
                self._buffer[layout.pixels[entries[tail]]] = colors
                body = np.flatnonzero(~behind)
                segment_of_entry = segment_of_entry[body]
                entries = entries[body]

        # Only segments that somebody hovers or has selected consist of more than their body
        roles = np.zeros(len(segment_of_entry), dtype=np.intp)
        stated = np.flatnonzero((segments.margins > 0)[segment_of_entry])
        if len(stated):
            stated_segments = segment_of_entry[stated]
            stated_entries = entries[stated]
            first, last = self._counted(segments, stated_segments, stated_entries, start_m, end_m)
            widest = self._margin[stated_entries]
            roles[stated] = self._roles(segments, stated_segments, widest, first, last)
        self._buffer[layout.pixels[entries]] = segments.palette[segment_of_entry, roles]

    def _counted(
        self, segments: Segments, segment_of_entry: Indices, entries: Indices, start_m: Array, end_m: Array
    ) -> tuple[Indices, Indices]:
        """Return for each pixel the numbers of its segment's pixels before and after it on the same strip.

        If the strip ends within the segment, pixels are counted as if it continued.
        """
        layout = self.layout
        run = layout.run[entries]
        number = layout.number[entries]

        # Lowest and highest number of each segment's pixels in each run
        runs = len(layout.pitch_m)
        stated = np.cumsum(segments.margins > 0) - 1
        slot = stated[segment_of_entry] * runs + run
        slots = (int(stated[-1]) + 1) * runs
        low = np.full(slots, layout.count, dtype=np.intp)
        high = np.zeros_like(low)
        np.minimum.at(low, slot, number)
        np.maximum.at(high, slot, number)
        low = low[slot]
        high = high[slot]

        # Pixels that are missing where the run ends within the segment
        pitch_m = layout.pitch_m[run]
        missing_before = (layout.first_m[run] - start_m[segment_of_entry]) / pitch_m
        missing_after = (end_m[segment_of_entry] - layout.last_m[run]) / pitch_m
        reaches_start = low == 0
        reaches_end = high == layout.pixels_of[run] - 1
        before = _whole(missing_before) * reaches_start
        after = _whole(missing_after) * reaches_end
        return number - low + before, high - number + after

    @staticmethod
    def _roles(
        segments: Segments, segment_of_entry: Indices, widest: Indices, first: Indices, last: Indices
    ) -> Indices:
        """Return the role of each pixel: the `first`-th from its segment's start, `last`-th from the end."""
        # The gauge fills the body from both ends
        nearer = np.minimum(first, last)
        count = first + last + 1
        roles = np.zeros(len(segment_of_entry), dtype=np.intp)
        progress = segments.progress[segment_of_entry]
        filled = np.rint(progress * count / 2.0)
        roles[nearer < filled] = FILL

        # The owner's pattern begins where full margins would end, also where the margins are thin
        margin = np.minimum(widest, count // 3)
        patterns = segments.patterns[segment_of_entry]
        if patterns.any():
            trailing = np.where(segments.forth[segment_of_entry], first, last)
            _draw_patterns(
                roles,
                patterns,
                inward=nearer - margin,
                along=first - margin,
                trailing=trailing - margin,
                body=count - 2 * margin,
            )

        # Margins are drawn over both, in alternating colours
        is_thin = segments.thin[segment_of_entry]
        margin = np.where(is_thin, np.minimum(margin, 1), margin)
        colors = segments.margins[segment_of_entry]
        # each end begins with another colour if there are more colours than pixels
        offset = (last < first) * np.maximum(colors - margin, 0)
        turn = (nearer + offset) % np.maximum(colors, 1)
        is_margin = nearer < margin
        roles[is_margin] = MARGIN + turn[is_margin]
        return roles

    def _draw_cursors(self, cursors: list[CursorMark]) -> None:
        layout = self.layout
        line, position_m, width_m, color = zip(*cursors, strict=True)
        lines = np.array(line, dtype=np.intp)
        colors = np.array(color, dtype=np.uint8)
        at_m = np.array(position_m)
        half_m = np.array(width_m) / 2.0
        start_m = at_m - half_m
        end_m = at_m + half_m
        cursor_of_entry, entries = layout.lit(lines, start_m, end_m)
        pixels = layout.pixels[entries]

        # The k-th cursor over a pixel shows if k is the pixel's number modulo the number of cursors
        if len(cursors) > 1 and len(pixels):
            order = np.lexsort((cursor_of_entry, pixels))
            pixels = pixels[order]
            cursor_of_entry = cursor_of_entry[order]
            begins = np.ones(len(pixels), dtype=np.bool_)
            np.not_equal(pixels[1:], pixels[:-1], out=begins[1:])
            group = np.cumsum(begins) - 1
            first_of_group = np.flatnonzero(begins)
            rank = np.arange(len(pixels)) - first_of_group[group]
            cursors_of_pixel = np.bincount(group)[group]
            shown = rank == layout.wire[pixels] % cursors_of_pixel
            pixels = pixels[shown]
            cursor_of_entry = cursor_of_entry[shown]
        self._buffer[pixels] = colors[cursor_of_entry]


def _whole(pixels: Array) -> Indices:
    rounded = np.maximum(pixels + _ROUNDING, 0.0)
    return np.minimum(rounded, _MANY).astype(np.intp)


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
