"""The live view of a run in the terminal: strips, cursors, people, rates, and the keyboard as a button."""

import contextlib
import functools
import math
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TypeAlias

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.live import Live
from rich.panel import Panel
from rich.segment import Segment, SegmentLines
from rich.table import Table
from rich.text import Text

from pointit.cli.common.keyboard import has_keyboard, keys
from pointit.cli.common.output import duration_text
from pointit.cli.summary import DisplayPart, figures
from pointit.diagnosis.symptoms import UNSURE_DEG, UNSURE_M, figure, yaw_sigma_deg
from pointit.geometry.floor_sigma import position_sigma_m
from pointit.geometry.polyline import Polyline
from pointit.launch.run.monitor import Monitor
from pointit.launch.run.running_scenario import RunningScenario
from pointit.schemas import NS_PER_S, ButtonEvent, Localization, Strip, StripsFrame, UserPose
from pointit.schemas.topics import BUTTON
from pointit.services.imu_bridge.device_wrist import BATTERY, GAPS, RATE, SIGNAL
from pointit.services.imu_bridge.page_wrist import LOW_BATTERY

Worth: TypeAlias = tuple[int, int] | None
"""Priority of a part: the lowest is left out first. None: always shown."""

WHITE = (255, 255, 255)
ROOMY_WIDTH = 72
"""Columns below which people's rows are shortened."""
AMPLE_WIDTH = 90
"""Columns below which the columns of poses are narrow."""
SCANT_WIDTH = 56
"""Columns below which only the position of a pose is shown."""

METHODS = {"fixed": "given", "static_targets": "lamps", "moving_target": "robot", "external": "tracker"}
"""Short name of each pose method."""

CANDIDATES = 3
"""Number of candidate robots that are named."""

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


def pose_lines(monitor: Monitor, width: int) -> RenderableType | None:
    """Return people's poses, or None if none is known."""
    if not any(user in monitor.poses for user in monitor.people()):
        return None
    columns = [("person", 6), ("stands at", 19)]
    if width >= SCANT_WIDTH:
        columns.append(("yaw", 13))
    if width >= ROOMY_WIDTH:
        columns += [("by", 5), ("drift", 9), ("anchor age", 10)]
    table = _table(width, AMPLE_WIDTH)
    for column, least in columns:
        table.add_column(column, no_wrap=True, min_width=least)
    for user in monitor.people():
        pose = monitor.poses.get(user)
        name = Text(user, style=color_of(monitor, user))
        cells = [Text("-")] * 5 if pose is None else _pose(pose, monitor.clock.now_ns())
        table.add_row(name, *cells[: len(columns) - 1])
    return table


def wrist_lines(monitor: Monitor) -> list[Text]:
    """Return the state of each device on a wrist, if it has a battery, a signal or gaps."""
    lines: list[Text] = []
    for user in monitor.people():
        health = monitor.health.get(f"imu-bridge.{user}")
        if health is None:
            continue
        charge, rate_hz, gaps, dbm = (figure(health, name) for name in (BATTERY, RATE, GAPS, SIGNAL))
        if charge is None and dbm is None and not gaps:
            continue
        parts = [
            Text(f"{rate_hz or 0.0:.0f} Hz"),
            Text(f"{gaps or 0.0:.0f} gaps/min", "yellow" if gaps else ""),
        ]
        if charge is not None:
            parts.insert(0, Text(f"battery {charge:.0f} %", "yellow" if charge < 100.0 * LOW_BATTERY else ""))
        if dbm is not None:
            parts.append(Text(f"signal {dbm:.0f} dBm"))
        lines.append(Text.assemble((f"{user}'s wrist: ", color_of(monitor, user)), Text(" · ").join(parts)))
    return lines


def instruction_lines(monitor: Monitor) -> list[Text]:
    """Return the next step of each person, as one line if it is the same for all."""
    words_of_user = {user: _words(monitor, user) for user in monitor.people()}
    if (
        len(words_of_user) > 1
        and len({tuple(line.plain for line in lines) for lines in words_of_user.values()}) == 1
    ):
        return [Text.assemble(("everybody: ", "bold"), line) for line in next(iter(words_of_user.values()))]
    return [
        Text.assemble((f"{user}: ", color_of(monitor, user)), line)
        for user, lines in words_of_user.items()
        for line in lines
    ]


def color_of(monitor: Monitor, user: str) -> str:
    """Return the style of a person's own colour; white is the terminal's text colour."""
    profile = monitor.profiles.get(user)
    color = WHITE if profile is None else profile.cursor_color
    return "bold" if color == WHITE else f"bold rgb({color[0]},{color[1]},{color[2]})"


def _table(width: int, roomy_width: int) -> Table:
    return Table(box=None, padding=(0, 1 if width < roomy_width else 2, 0, 0), header_style="dim")


def activity_lines(monitor: Monitor, width: int) -> RenderableType:
    """Return the activity of each person, in columns of constant width."""
    narrow = width < ROOMY_WIDTH
    bar = 4 if narrow else 10
    table = _table(width, ROOMY_WIDTH)
    for column, least in (("person", 6), ("state", 10), ("cursor", 6 if narrow else 18), ("object", 6)):
        table.add_column(column, no_wrap=True, min_width=least)
    table.add_column("held", no_wrap=True, min_width=bar)
    for user in monitor.people():
        interaction = monitor.interactions.get(user)
        cursor = monitor.cursors.get(user)
        hover = monitor.hovers.get(user)
        where = "-"
        if cursor is not None and cursor.surface != "none":
            place = "" if narrow else f"{cursor.surface} {cursor.surface_id} at "
            where = f"{place}{cursor.position_m:.2f} m"
        elif cursor is not None and cursor.solid:
            where = cursor.solid if narrow else f"{cursor.solid} {cursor.surface_id}"
        kind = "-"
        filled = 0
        if hover is not None and hover.object_id:
            kind = monitor.score.kinds.get(hover.object_id) or "?"
            filled = round(bar * hover.progress)
        state = interaction.state if interaction is not None else "-"
        table.add_row(
            Text(user, style=color_of(monitor, user)), state, where, kind, "█" * filled + "░" * (bar - filled)
        )
    return table


def _pose(pose: UserPose, now_ns: int) -> list[Text]:
    sigma_m = position_sigma_m(pose.covariance)
    sigma_deg = yaw_sigma_deg(pose)
    place = Text(f"{pose.position_m[0]:.2f}, {pose.position_m[1]:.2f}")
    yaw = Text(f"{math.degrees(math.remainder(pose.yaw_rad, math.tau)):.1f}°")
    if sigma_m > 0.0:
        place.append(f" ±{sigma_m:.2f}", style="yellow" if sigma_m > UNSURE_M else "")
    if sigma_deg > 0.0:
        yaw.append(f" ±{sigma_deg:.1f}°", style="yellow" if sigma_deg > UNSURE_DEG else "")
    drift = "-"
    if pose.yaw_rate_sigma_radps is not None:
        drift = f"{math.degrees(pose.yaw_rate_radps) * 60:+.1f}°/min"
    anchor = "-" if pose.anchored_ns == 0 else duration_text((now_ns - pose.anchored_ns) / NS_PER_S)
    return [place.append(" m"), yaw, Text(METHODS[pose.method]), Text(drift), Text(anchor)]


def _words(monitor: Monitor, user: str) -> list[Text]:
    lines: list[Text] = []
    refusal = monitor.refusal(user)
    interaction = monitor.interactions.get(user)
    if refusal:
        lines.append(Text(f"refused: {refusal}", style="bold red"))
    cursor = monitor.cursors.get(user)
    if cursor is not None and cursor.passed is not None and cursor.passed.text:
        lines.append(Text(cursor.passed.text, style="yellow"))
    elif interaction is not None:
        reason = interaction.reason if interaction.state == "idle" and interaction.reason != refusal else ""
        lines.append(Text(f"{reason} {interaction.next_step}".strip()))
    localization = monitor.localizations.get(user)
    if (
        localization is not None
        and localization.phase == "sampling"
        and (localization.samples or localization.target_id)
    ):  # not who waits
        lines.append(Text.assemble(*_progress(localization)))
    return lines


def _progress(localization: Localization) -> list[str | tuple[str, str]]:
    """Return the target, the samples so far and the current uncertainty."""
    parts: list[str] = []
    if localization.target_count > 1:
        parts.append(f"{localization.target_index + 1} of {localization.target_count}")
    parts.append(f"{localization.samples} samples")
    if localization.position_sigma_m is not None:
        parts.append(f"±{localization.position_sigma_m:.2f} m")
    if localization.yaw_sigma_rad is not None:
        parts.append(f"±{math.degrees(localization.yaw_sigma_rad):.1f}°")
    if len(localization.candidates) > 1:
        named = ", ".join(
            f"{candidate.object_id} {candidate.probability:.0%}"
            for candidate in localization.candidates[:CANDIDATES]
        )
        parts.append(f"meant: {named}")
    purpose = "setting the pose right, " if localization.purpose == "anchor" else ""
    target: tuple[str, str] = (
        f"● {localization.target_id} " if localization.target_id else "",
        "bold yellow",
    )
    return [purpose, target, " · ".join(parts)]


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
        is_roomy = whole_width >= ROOMY_WIDTH
        left_s = self.remaining_s()
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
        parts.append((None, activity_lines(monitor, whole_width)))
        for each in self.parts:
            if (rows := each.rows(monitor, whole_width)) is not None:
                parts.append((None, rows))
                parts += [((WORDS, -row), line) for row, line in enumerate(each.lines(monitor))]
        if (where := pose_lines(monitor, whole_width)) is not None:
            parts.append(((PLACES, 0), where))
        parts += [((PLACES, -1 - row), line) for row, line in enumerate(wrist_lines(monitor))]
        parts += [((WORDS, -row), line) for row, line in enumerate(instruction_lines(monitor))]
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
            mark = Text("▲" if len(cursors) == 1 else user[-1], style=color_of(monitor, user))
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


@contextlib.contextmanager
def on_screen(
    scenario: RunningScenario,
    console: Console,
    end_s: Callable[[], float | None],
    looks_on: Callable[[], bool],
    parts: Sequence[DisplayPart],
) -> Generator[None]:
    """Draw the run in the terminal. Its Space key is the first person's button.

    Args:
        scenario: the scenario to draw; it may change.
        console: the terminal.
        end_s: returns the monotonic time when the run ends by itself, if ever.
        looks_on: returns True if a page is open, for which the run continues.
        parts: what optional rooms show in it.
    """
    button = functools.cache(functools.partial(scenario.bus.publisher, BUTTON))

    def press() -> None:
        person = _first_person(scenario)
        if person:
            button(person).put(ButtonEvent(stamp_ns=scenario.clock.now_ns(), source="keyboard"))

    def left_s() -> float:
        over_s = end_s()
        return 0.0 if over_s is None else max(0.0, over_s - time.monotonic())

    def drawn() -> RenderableType:
        return ConsoleView(
            scenario.monitor,
            f"PointIt {scenario.plan.name}",
            left_s,
            _first_person(scenario) if has_keyboard() else "",
            page=scenario.address,
            parts=parts,
            is_looked_on=end_s() is not None and looks_on(),
        )

    live = Live(get_renderable=drawn, console=console, refresh_per_second=REFRESH_HZ, transient=True)
    with contextlib.ExitStack() as stack:
        if has_keyboard():
            stack.enter_context(keys(press))
        stack.enter_context(live)
        yield


def _first_person(scenario: RunningScenario) -> str:
    return next(iter(scenario.plan.users), "")
