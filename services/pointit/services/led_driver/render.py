"""Objects and cursors to pixels (paper, §III-E): the position of the cursor and of objects, and their state.

An object is a segment in the colour of its kind: dim, or bright when it is selected. Its ends tell more:
white when it is selected, in the person's colour while they hover it; meanwhile the body changes from both
ends to the middle, as far as the selection has come. Cursors lie on top; where several meet, they alternate
pixel by pixel.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.schemas import Strip
from pointit.services.led_driver.config import Color, StyleConfig

Pixels = NDArray[np.uint8]
"""n x 3, red green blue."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CursorMark:
    """A cursor to draw."""

    strip_id: str
    position_m: float
    width_m: float
    color: Color


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectMark:
    """An object to draw, centred on `position_m`."""

    strip_id: str
    position_m: float
    length_m: float
    kind: str = ""
    selected: bool = False
    progress: float = 0.0
    """How far the next change of its selection has come, 0 to 1."""
    hover_color: Color | None = None
    """The colour of the person whose cursor is on it."""


MAX_PIXELS = 64 * 4096
"""Of all strips together: a frame of more would be longer than its message may be."""

_BEYOND = 1e9
"""Pixels: nothing is drawn further beyond an end of a strip, so that numbers of pixels fit 64 bits."""

_ROUNDING = 1e-6
"""Pixels: how far beyond an end of a strip is still its end."""


class _Canvas:
    """One strip: arc length to pixels, in the order of the wire."""

    def __init__(self, strip: Strip, wire: Pixels) -> None:
        length_m = Polyline(strip.line_m).length_m
        self.count = strip.pixels
        self.per_m = strip.pixels / length_m
        self.pixels = wire if strip.direction == 1 else wire[::-1]
        """A view in the order of the line: pixel k has its centre at (k + ½) / per_m."""

    def span(self, start_m: float, end_m: float) -> tuple[int, int]:
        """Return first and one-past-last pixel with their centres in [start_m, end_m]; not clipped.

        What is shorter than a pixel lights the one it is in.
        """
        start, end = self._pixel(start_m), self._pixel(end_m)
        first = math.ceil(start - 0.5)
        last = math.floor(end - 0.5) + 1
        if last > first:
            return first, last
        middle = (start + end) / 2.0
        if -_ROUNDING <= middle <= self.count + _ROUNDING:  # the very ends belong to the strip
            middle = min(max(middle, 0), self.count - 1)
        return math.floor(middle), math.floor(middle) + 1

    def _pixel(self, position_m: float) -> float:
        return min(max(position_m * self.per_m, -_BEYOND), _BEYOND)

    def paint(self, first: int, last: int, color: Sequence[int]) -> None:
        """Colour the pixels from `first` up to, not with, `last`; what is beyond the strip is left out."""
        first, last = max(first, 0), min(last, self.count)
        if last > first:
            self.pixels[first:last] = color


class Renderer:
    """Draws frames for one map; all strips lie in one buffer, so that what concerns all is one operation."""

    def __init__(self, strips: Sequence[Strip], style: StyleConfig | None = None) -> None:
        """Lay `strips` out one after the other.

        Raises:
            ValueError: the line of a strip has no length, or there are more pixels than a frame can hold.
        """
        self._style = style if style is not None else StyleConfig()
        counts = [strip.pixels for strip in strips]
        if sum(counts) > MAX_PIXELS:
            raise ValueError(f"all have {sum(counts)} pixels together, a frame holds {MAX_PIXELS}")
        ends = list(itertools.accumulate(counts))
        self._buffer: Pixels = np.zeros((sum(counts), 3), dtype=np.uint8)
        self._slices = {
            strip.id: slice(3 * (end - strip.pixels), 3 * end)
            for strip, end in zip(strips, ends, strict=True)
        }
        self._canvases = {
            strip.id: _Canvas(strip, self._buffer[end - strip.pixels : end])
            for strip, end in zip(strips, ends, strict=True)
        }
        colors = {**self._style.kind_colors, "": self._style.default_color}
        self._bright = colors
        self._dim = {kind: _scaled(color, self._style.idle_level) for kind, color in colors.items()}
        self._table = np.arange(256, dtype=np.uint8)
        self.brightness = 1.0

    def set_brightness(self, brightness: float) -> None:
        """Dim everything to `brightness`, 0 to 1."""
        self.brightness = brightness
        self._table = np.rint(np.arange(256) * brightness).astype(np.uint8)

    def render(self, objects: Iterable[ObjectMark], cursors: Sequence[CursorMark]) -> dict[str, bytes]:
        """Return each strip's bytes: red green blue, pixel 0 of the wire first."""
        self._buffer.fill(0)
        for mark in objects:
            canvas = self._canvases.get(mark.strip_id)
            if canvas is not None:
                self._draw_object(canvas, mark)
        for strip_id, group in itertools.groupby(
            sorted(cursors, key=lambda mark: mark.strip_id), key=lambda mark: mark.strip_id
        ):
            canvas = self._canvases.get(strip_id)
            if canvas is not None:
                _draw_cursors(canvas, list(group))
        pixels = self._buffer if self.brightness == 1.0 else self._table[self._buffer]
        data = pixels.tobytes()
        return {strip_id: data[where] for strip_id, where in self._slices.items()}

    def _draw_object(self, canvas: _Canvas, mark: ObjectMark) -> None:
        half_m = mark.length_m / 2.0
        first, last = canvas.span(mark.position_m - half_m, mark.position_m + half_m)
        if last <= 0 or first >= canvas.count:
            return
        kind = mark.kind if mark.kind in self._bright else ""
        levels = (self._dim[kind], self._bright[kind])
        canvas.paint(first, last, levels[mark.selected])
        if mark.hover_color is not None:
            filled = round(mark.progress * (last - first) / 2.0)
            canvas.paint(first, first + filled, levels[not mark.selected])
            canvas.paint(last - filled, last, levels[not mark.selected])
        elif not mark.selected:
            return
        edge = min(max(round(self._style.edge_m * canvas.per_m), 1), (last - first) // 3)
        color = mark.hover_color or self._style.selected_edge_color
        canvas.paint(first, first + edge, color)
        canvas.paint(last - edge, last, color)


def _draw_cursors(canvas: _Canvas, marks: Sequence[CursorMark]) -> None:
    spans = [
        canvas.span(mark.position_m - mark.width_m / 2.0, mark.position_m + mark.width_m / 2.0)
        for mark in marks
    ]
    if len(marks) == 1:
        canvas.paint(*spans[0], marks[0].color)
        return
    index = np.arange(canvas.count)
    bounds = np.array(spans)
    covers = (index >= bounds[:, :1]) & (index < bounds[:, 1:])
    count = covers.sum(axis=0)
    lit = np.flatnonzero(count)
    # the k-th of the cursors over a pixel shows when k is the pixel's number modulo how many there are
    turn = covers[:, lit].cumsum(axis=0) - 1 == index[lit] % count[lit]
    owner = np.argmax(turn & covers[:, lit], axis=0)
    canvas.pixels[lit] = np.array([mark.color for mark in marks], dtype=np.uint8)[owner]


def _scaled(color: Color, level: float) -> Color:
    red, green, blue = (round(value * level) for value in color)
    return (red, green, blue)
