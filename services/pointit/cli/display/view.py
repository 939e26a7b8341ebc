"""The terminal view: strips in their real colours, cursors, people, rates and latency."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TypeAlias

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.panel import Panel
from rich.segment import Segment, SegmentLines
from rich.text import Text

from pointit.cli.display import people_view
from pointit.cli.display.display_part import DisplayPart
from pointit.cli.display.summary import figures
from pointit.geometry.polyline import Polyline
from pointit.launch.run.monitor import Monitor
from pointit.schemas import Strip, StripsFrame

REFRESH_HZ = 8
"""Refresh rate of the view, which is drawn in a thread of its own."""
NAME_WIDTH = 8
BORDER_WIDTH = 4
"""Columns of the frame and its padding."""
MAX_STRIPS = 6
"""Strips drawn one per line; more are drawn side by side, without the marks below them."""
MARGINS = 6
"""Columns of the border that its title cannot use."""
BORDER_HEIGHT = 2
GAP_WIDTH = 2
CELLS_PER_M = 8
"""Scale of strips drawn side by side; it shrinks if one is wider than the terminal."""
OLD_EVENTS, PLACES, EVENTS, WORDS, STRIPS = range(5)
"""Order in which parts are left out of a low terminal."""
END = "Ctrl-C ends it"
Worth: TypeAlias = tuple[int, int] | None
"""Priority of a part: the lowest is left out first. None: always shown."""


@dataclass(frozen=True)
class ConsoleView:
    """The view of `monitor`, rendered with its contents and the terminal's width at that time."""

    monitor: Monitor
    title: str
    remaining_s: Callable[[], float]
    """Returns the remaining time; 0 if the run does not end by itself."""
    button_of: str = ""
    """The person whose button the Space key is, or `""`."""
    page: str = ""
    """URL of the page, or `""`."""
    is_looked_on: bool = False
    """A page is open, for which the run continues after its duration."""
    parts: Sequence[DisplayPart] = ()
    """Parts that optional rooms show in it."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width = max(1, options.max_width - BORDER_WIDTH)
        inner = options.update(width=width, height=None)
        blocks = [
            TextBlock(console.render_lines(part, inner), worth)
            for worth, part in self._parts(width, options.max_width)
        ]
        segments = drop_to_height(blocks, options.size.height - BORDER_HEIGHT)
        yield Panel(
            SegmentLines(segments, new_lines=True),
            title=f"{self.title} ● recording" if self.monitor.is_recorded else self.title,
            subtitle=self._subtitle(options.max_width),
            border_style="cyan",
        )

    def _subtitle(self, whole_width: int) -> str:
        is_roomy, left_s = whole_width >= people_view.ROOMY_WIDTH, self.remaining_s()
        if self.is_looked_on:
            if left_s <= 0:
                is_open = "a page is open"
                return f"{is_open}: goes on until Ctrl-C or it closes" if is_roomy else f"{is_open}, {END}"
            if not is_roomy:
                return f"{left_s:.0f} s left + page, {END}"
        hints = [f"{left_s:.0f} s left"] if left_s > 0 else []
        if self.is_looked_on:
            hints.append("a page is open: goes on after that")
        button = f"Space is {self.button_of}'s button"
        if self.button_of and is_roomy and len(", ".join([*hints, button, END])) <= whole_width - MARGINS:
            hints.append(button)
        return ", ".join([*hints, END])

    def _parts(self, width: int, whole_width: int) -> list[tuple[Worth, RenderableType]]:
        """Return the parts to show, each with its priority on a low terminal."""
        monitor = self.monitor
        environment = monitor.environment
        parts: list[tuple[Worth, RenderableType]] = []
        if self.page:
            parts.append((None, Text(f"page: {self.page}", style="bold", overflow="fold")))
        if environment is None:
            parts.append((None, Text("waiting for the map …", style="dim")))
        else:
            if len(environment.strips) > MAX_STRIPS:
                light = _side_by_side(monitor, environment.strips, width)
            else:
                light = [
                    line
                    for strip in environment.strips
                    for line in _strip(monitor, strip, width, _name_width(environment.strips, width))
                ]
            parts += [((STRIPS, -row), line) for row, line in enumerate(light)]
            if monitor.lamps:
                parts.append((None, _lamps(monitor)))
        parts.append((None, people_view.activity_lines(monitor, whole_width)))
        for each in self.parts:
            if (rows := each.rows(monitor, whole_width)) is not None:
                parts.append((None, rows))
                parts += [((WORDS, -row), line) for row, line in enumerate(each.lines(monitor))]
        if (where := people_view.pose_lines(monitor, whole_width)) is not None:
            parts.append(((PLACES, 0), where))
        parts += [((PLACES, -1 - row), line) for row, line in enumerate(people_view.wrist_lines(monitor))]
        parts += [((WORDS, -row), line) for row, line in enumerate(people_view.instruction_lines(monitor))]
        parts.append((None, figures(monitor)))
        events = list(monitor.events)
        for row, line in enumerate(events, 1):
            worth = (EVENTS if row == len(events) else OLD_EVENTS, row)
            parts.append((worth, Text(line, style="dim", no_wrap=True, overflow="ellipsis")))
        return parts


def _name_width(strips: Sequence[Strip], width: int) -> int:
    return max(NAME_WIDTH, min(max(len(strip.id) for strip in strips) + 1, int(0.3 * width)))


def _name(strip: Strip, width: int) -> str:
    return f"{strip.id} " if len(strip.id) < width else f"{strip.id[: width - 2]}… "


def _strip(monitor: Monitor, strip: Strip, width: int, name_width: int) -> list[Text]:
    """Return a strip's pixels as coloured half blocks, two pixels per cell, and the cursors below."""
    pixels = pixels_along(monitor.frame, strip)
    cells = max(1, min(width - name_width, (len(pixels) + 1) // 2))
    line = Text(f"{_name(strip, name_width):<{name_width}}", style="bold", no_wrap=True)
    _light(line, pixels, cells)
    marks = Text(" " * (name_width + cells), no_wrap=True)
    length = Polyline(strip.line_m).length_m
    cursors = sorted(monitor.cursors.items())
    for user, cursor in cursors:
        if cursor.surface == "strip" and cursor.surface_id == strip.id:
            cell = min(cells - 1, int(cursor.position_m / length * cells))
            mark = Text("▲" if len(cursors) == 1 else user[-1], style=people_view.color_of(monitor, user))
            at = name_width + cell
            marks = Text.assemble(marks[:at], mark, marks[at + 1 :], no_wrap=True)
    return [line, marks]


def _light(line: Text, pixels: Sequence[tuple[int, int, int]], cells: int) -> None:
    columns = 2 * cells
    pairs = (
        (
            pixels[(2 * cell) * len(pixels) // columns],
            pixels[min((2 * cell + 1) * len(pixels) // columns, len(pixels) - 1)],
        )
        for cell in range(cells)
    )
    for (left, right), run in groupby(pairs):  # fewer escape sequences: one per change of colour
        style = f"rgb({left[0]},{left[1]},{left[2]}) on rgb({right[0]},{right[1]},{right[2]})"
        line.append("▌" * len(list(run)), style=style)


def _side_by_side(monitor: Monitor, strips: Sequence[Strip], width: int) -> list[Text]:
    """Return many strips to scale, as many in a row as fit; cursors show only by their light."""
    lengths_m = [Polyline(strip.line_m).length_m for strip in strips]
    name_width = _name_width(strips, width)
    scale = min(CELLS_PER_M, (width - name_width) / max(lengths_m))
    rows = [Text(no_wrap=True)]
    for strip, length_m in zip(strips, lengths_m, strict=True):
        name = _name(strip, name_width)
        cells = max(1, int(length_m * scale))
        if rows[-1].cell_len and rows[-1].cell_len + GAP_WIDTH + len(name) + cells > width:
            rows.append(Text(no_wrap=True))
        rows[-1].append(" " * GAP_WIDTH if rows[-1].cell_len else "")
        rows[-1].append(name, style="bold")
        _light(rows[-1], pixels_along(monitor.frame, strip), cells)
    return rows


def pixels_along(frame: StripsFrame | None, strip: Strip) -> list[tuple[int, int, int]]:
    """Return a strip's pixels from the start of its line to the end, in either wiring direction."""
    rgb = b""
    if frame is not None:
        rgb = next((shown.rgb for shown in frame.strips if shown.id == strip.id), b"")
    if len(rgb) < 3:
        return [(0, 0, 0)] * strip.pixels
    pixels = [(rgb[i], rgb[i + 1], rgb[i + 2]) for i in range(0, len(rgb) - 2, 3)]
    return pixels if strip.direction == 1 else pixels[::-1]


def _lamps(monitor: Monitor) -> Text:
    text = Text(f"{'lamps':<{NAME_WIDTH}}", style="bold")
    for name, lamp in sorted(monitor.lamps.items()):
        on = any(lamp.color)
        colour = f"rgb({lamp.color[0]},{lamp.color[1]},{lamp.color[2]})" if on else "dim"
        text.append(f"{'●' if on else '○'} {name}  ", style=colour)
    return text


@dataclass(frozen=True)
class TextBlock:
    """Lines shown or left out together."""

    lines: Sequence[Sequence[Segment]]
    priority: Worth


def drop_to_height(blocks: Sequence[TextBlock], room: int) -> list[list[Segment]]:
    """Return at most `room` lines of `blocks` in their order, without those of lowest priority."""
    height = sum(len(block.lines) for block in blocks)
    remaining = dict(enumerate(blocks))
    dispensable = sorted(
        (block.priority, at) for at, block in remaining.items() if block.priority is not None
    )
    for _, at in dispensable:
        if height <= room:
            break
        height -= len(remaining.pop(at).lines)
    return [list(line) for block in remaining.values() for line in block.lines]
