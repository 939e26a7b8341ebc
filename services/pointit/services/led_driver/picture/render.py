"""Renders segments and cursors to pixels (paper, §III-E), with one operation per kind of object.

An object is a segment in the colour of its kind, dim, or bright if selected. Its margins have the colour of
the person who hovers or has selected it, alternating by pixel if there are several colours. The body changes
from both ends to the middle with the progress of selection. Dark pixels in the body of a selected object
form the owner's pattern. Cursors are drawn on top, alternating by pixel where several overlap.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.schemas.base import Rgb
from pointit.services.led_driver.config import StyleConfig
from pointit.services.led_driver.picture.layout import Array, Indices, Layout

Bytes = NDArray[np.uint8]
PATTERNS = ("solid", "dashed", "dotted", "striped", "hollow", "tailed")
"""Patterns of the profile. A segment has the index."""
_DASHED, _DOTTED, _STRIPED, _HOLLOW, _TAILED = range(1, 6)
BODY, FILL, GAP, OWNER, MARGIN = range(5)
"""Roles of pixels: body, its other level by the gauge, dark of patterns, owner's colour, margins."""
MARGIN_COLORS = 4
"""Maximum number of alternating colours."""
ROLES = MARGIN + MARGIN_COLORS
_ROUNDING = 1e-6
"""Tolerance, pixels."""
_ROUNDING_M = 1e-9
"""Distance beyond an object's end at which a pixel is still on it."""
_MANY = 1e9
"""Limit of the count of pixels."""


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
    length_m = np.minimum(np.abs(speed_mps) * style.tail_s, style.tail_max_m)
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
        start_m, end_m = segments.at_m - segments.half_m, segments.at_m + segments.half_m
        tails_m = segments.tail_m
        if tails_m is None:
            line_of_entry, entries = layout.lit(segments.lines, start_m, end_m)
        else:
            line_of_entry, entries = layout.lit(segments.lines, start_m - tails_m[0], end_m + tails_m[1])
        if not len(entries):
            return
        at_m = layout.at_m[entries]
        before_m, after_m = at_m - start_m[line_of_entry], end_m[line_of_entry] - at_m
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
                line_of_entry, entries, before_m, after_m = (
                    line_of_entry[body],
                    entries[body],
                    before_m[body],
                    after_m[body],
                )
        roles = np.zeros(len(line_of_entry), dtype=np.intp)
        stated = np.flatnonzero((segments.margins > 0)[line_of_entry])
        if len(stated):
            those, these = line_of_entry[stated], entries[stated]
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
        run, number = layout.run[entries], layout.number[entries]
        stated = np.cumsum(segments.margins > 0) - 1
        slot = stated[line_of_entry] * len(layout.pitch_m) + run
        low = np.full((int(stated[-1]) + 1) * len(layout.pitch_m), layout.count, dtype=np.intp)
        high = np.zeros_like(low)
        np.minimum.at(low, slot, number)
        np.maximum.at(high, slot, number)
        low, high = low[slot], high[slot]
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
        lines, colors = np.array(line, dtype=np.intp), np.array(color, dtype=np.uint8)
        at_m, half_m = np.array(place_m), np.array(width_m) / 2.0
        line_of_entry, entries = layout.lit(lines, at_m - half_m, at_m + half_m)
        pixels = layout.pixels[entries]
        if len(cursors) > 1 and len(pixels):
            # the k-th cursor over a pixel shows if k is the pixel's number modulo the number of cursors
            order = np.lexsort((line_of_entry, pixels))
            pixels, line_of_entry = pixels[order], line_of_entry[order]
            begins = np.ones(len(pixels), dtype=np.bool_)
            np.not_equal(pixels[1:], pixels[:-1], out=begins[1:])
            group = np.cumsum(begins) - 1
            rank = np.arange(len(pixels)) - np.flatnonzero(begins)[group]
            shown = rank == layout.wire[pixels] % np.bincount(group)[group]
            pixels, line_of_entry = pixels[shown], line_of_entry[shown]
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
