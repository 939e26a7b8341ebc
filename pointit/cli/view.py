"""The live view of a run in the terminal: strips, cursors, people, rates, and the keyboard as a button."""

import contextlib
import functools
import math
import time
from collections.abc import Callable, Generator, Iterable, Sequence
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
        cells = [Text("-")] * 5
        if pose is not None:
            cells = _pose(pose, monitor.clock.now_ns())
        table.add_row(name, *cells[: len(columns) - 1])
    return table


def wrist_lines(monitor: Monitor) -> list[Text]:
    """Return the state of each device on a wrist, if it has a battery, a signal or gaps."""
    lines: list[Text] = []
    for user in monitor.people():
        health = monitor.health.get(f"imu-bridge.{user}")
        if health is None:
            continue
        charge = figure(health, BATTERY)
        signal_dbm = figure(health, SIGNAL)
        gaps = figure(health, GAPS) or 0.0
        rate_hz = figure(health, RATE) or 0.0

        # Wrists that are no device have none of these
        is_device = charge is not None or signal_dbm is not None
        if not is_device and not gaps:
            continue
        parts: list[Text] = []
        if charge is not None:
            is_low = charge < 100.0 * LOW_BATTERY
            style = "yellow" if is_low else ""
            parts.append(Text(f"battery {charge:.0f} %", style))
        parts.append(Text(f"{rate_hz:.0f} Hz"))
        style = "yellow" if gaps else ""
        parts.append(Text(f"{gaps:.0f} gaps/min", style))
        if signal_dbm is not None:
            parts.append(Text(f"signal {signal_dbm:.0f} dBm"))
        name = (f"{user}'s wrist: ", color_of(monitor, user))
        lines.append(Text.assemble(name, Text(" · ").join(parts)))
    return lines


def instruction_lines(monitor: Monitor) -> list[Text]:
    """Return the next step of each person, as one line if it is the same for all."""
    lines_of_user = {user: _words(monitor, user) for user in monitor.people()}
    distinct = {_plain(lines) for lines in lines_of_user.values()}
    if len(lines_of_user) > 1 and len(distinct) == 1:
        common = next(iter(lines_of_user.values()))
        return [Text.assemble(("everybody: ", "bold"), line) for line in common]
    named: list[Text] = []
    for user, lines in lines_of_user.items():
        name = (f"{user}: ", color_of(monitor, user))
        named += [Text.assemble(name, line) for line in lines]
    return named


def _plain(lines: Iterable[Text]) -> tuple[str, ...]:
    return tuple(line.plain for line in lines)


def color_of(monitor: Monitor, user: str) -> str:
    """Return the style of a person's own colour; white is the terminal's text colour."""
    profile = monitor.profiles.get(user)
    color = WHITE if profile is None else profile.cursor_color
    return "bold" if color == WHITE else f"bold {_style(color)}"


def _style(color: tuple[int, int, int]) -> str:
    red, green, blue = color
    return f"rgb({red},{green},{blue})"


def _table(width: int, roomy_width: int) -> Table:
    gap = 1 if width < roomy_width else 2
    return Table(box=None, padding=(0, gap, 0, 0), header_style="dim")


def activity_lines(monitor: Monitor, width: int) -> RenderableType:
    """Return the activity of each person, in columns of constant width."""
    is_narrow = width < ROOMY_WIDTH
    bar = 4 if is_narrow else 10
    cursor_width = 6 if is_narrow else 18
    table = _table(width, ROOMY_WIDTH)
    columns = (("person", 6), ("state", 10), ("cursor", cursor_width), ("object", 6))
    for column, least in columns:
        table.add_column(column, no_wrap=True, min_width=least)
    table.add_column("held", no_wrap=True, min_width=bar)

    for user in monitor.people():
        # Where the cursor is, or what it is behind
        cursor = monitor.cursors.get(user)
        place = "-"
        if cursor is not None and cursor.surface != "none":
            surface = "" if is_narrow else f"{cursor.surface} {cursor.surface_id} at "
            place = f"{surface}{cursor.position_m:.2f} m"
        elif cursor is not None and cursor.solid:
            place = cursor.solid if is_narrow else f"{cursor.solid} {cursor.surface_id}"

        # The object that is hovered, and how far its selection is
        hover = monitor.hovers.get(user)
        kind = "-"
        filled = 0
        if hover is not None and hover.object_id:
            kind = monitor.score.kinds.get(hover.object_id) or "?"
            filled = round(bar * hover.progress)
        gauge = "█" * filled + "░" * (bar - filled)

        interaction = monitor.interactions.get(user)
        state = "-" if interaction is None else interaction.state
        name = Text(user, style=color_of(monitor, user))
        table.add_row(name, state, place, kind, gauge)
    return table


def _pose(pose: UserPose, now_ns: int) -> list[Text]:
    # An assumed pose has no uncertainty to show
    x_m, y_m, _ = pose.position_m
    sigma_m = position_sigma_m(pose.covariance)
    position = Text(f"{x_m:.2f}, {y_m:.2f}")
    if sigma_m > 0.0:
        style = "yellow" if sigma_m > UNSURE_M else ""
        position.append(f" ±{sigma_m:.2f}", style=style)
    position.append(" m")

    yaw_rad = math.remainder(pose.yaw_rad, math.tau)
    sigma_deg = yaw_sigma_deg(pose)
    yaw = Text(f"{math.degrees(yaw_rad):.1f}°")
    if sigma_deg > 0.0:
        style = "yellow" if sigma_deg > UNSURE_DEG else ""
        yaw.append(f" ±{sigma_deg:.1f}°", style=style)

    drift = "-"
    if pose.yaw_rate_sigma_radps is not None:
        drift_degpmin = math.degrees(pose.yaw_rate_radps) * 60
        drift = f"{drift_degpmin:+.1f}°/min"
    anchor_age = "-"
    if pose.anchored_ns != 0:
        anchor_age = duration_text((now_ns - pose.anchored_ns) / NS_PER_S)
    method = METHODS[pose.method]
    return [position, yaw, Text(method), Text(drift), Text(anchor_age)]


def _words(monitor: Monitor, user: str) -> list[Text]:
    lines: list[Text] = []
    refusal = monitor.refusal(user)
    if refusal:
        lines.append(Text(f"refused: {refusal}", style="bold red"))

    # What they point past comes before the next step: they can see it
    cursor = monitor.cursors.get(user)
    cue = None if cursor is None else cursor.passed
    interaction = monitor.interactions.get(user)
    if cue is not None and cue.text:
        lines.append(Text(cue.text, style="yellow"))
    elif interaction is not None:
        reason = ""
        if interaction.state == "idle" and interaction.reason != refusal:
            reason = interaction.reason
        step = f"{reason} {interaction.next_step}"
        lines.append(Text(step.strip()))

    # Who waits for a target has no progress yet
    localization = monitor.localizations.get(user)
    if localization is not None and localization.phase == "sampling":
        if localization.samples or localization.target_id:
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
        yaw_sigma = math.degrees(localization.yaw_sigma_rad)
        parts.append(f"±{yaw_sigma:.1f}°")

    # Several robots may be meant by one movement
    if len(localization.candidates) > 1:
        candidates = localization.candidates[:CANDIDATES]
        named = [f"{candidate.object_id} {candidate.probability:.0%}" for candidate in candidates]
        parts.append(f"meant: {', '.join(named)}")

    purpose = "setting the pose right, " if localization.purpose == "anchor" else ""
    target = f"● {localization.target_id} " if localization.target_id else ""
    return [purpose, (target, "bold yellow"), " · ".join(parts)]


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
        blocks: list[TextBlock] = []
        for priority, part in self._parts(width, options.max_width):
            blocks.append(TextBlock(console.render_lines(part, inner), priority))
        segments = drop_to_height(blocks, options.size.height - BORDER_HEIGHT)
        title = self.title
        if self.monitor.is_recorded:
            title += " ● recording"
        yield Panel(
            SegmentLines(segments, new_lines=True),
            title=title,
            subtitle=self._subtitle(options.max_width),
            border_style="cyan",
        )

    def _subtitle(self, whole_width: int) -> str:
        is_roomy = whole_width >= ROOMY_WIDTH
        remaining_s = self.remaining_s()

        # A page that is open keeps the run from its end
        if self.is_looked_on and remaining_s <= 0:
            is_open = "a page is open"
            return f"{is_open}: goes on until Ctrl-C or it closes" if is_roomy else f"{is_open}, {END}"
        if self.is_looked_on and not is_roomy:
            return f"{remaining_s:.0f} s left + page, {END}"
        hints: list[str] = []
        if remaining_s > 0:
            hints.append(f"{remaining_s:.0f} s left")
        if self.is_looked_on:
            hints.append("a page is open: goes on after that")

        # The button is named where the border has room for it
        if self.button_of and is_roomy:
            button = f"Space is {self.button_of}'s button"
            subtitle = ", ".join([*hints, button, END])
            if len(subtitle) <= whole_width - MARGINS:
                return subtitle
        return ", ".join([*hints, END])

    def _parts(self, width: int, whole_width: int) -> list[tuple[Worth, RenderableType]]:
        """Return the parts to show, each with its priority on a low terminal."""
        monitor = self.monitor
        parts: list[tuple[Worth, RenderableType]] = []
        if self.page:
            parts.append((None, Text(f"page: {self.page}", style="bold", overflow="fold")))

        # Light first: of the strips the last line is left out first
        environment = monitor.environment
        if environment is None:
            parts.append((None, Text("waiting for the map …", style="dim")))
        else:
            light = _light_lines(monitor, environment.strips, width)
            parts += [((STRIPS, -row), line) for row, line in enumerate(light)]
            if monitor.lamps:
                parts.append((None, _lamps(monitor)))

        # People, and what optional rooms show of robots and things
        parts.append((None, activity_lines(monitor, whole_width)))
        for display in self.parts:
            rows = display.rows(monitor, whole_width)
            if rows is not None:
                lines = display.lines(monitor)
                parts.append((None, rows))
                parts += [((WORDS, -row), line) for row, line in enumerate(lines)]
        poses = pose_lines(monitor, whole_width)
        if poses is not None:
            parts.append(((PLACES, 0), poses))
        wrists = wrist_lines(monitor)
        parts += [((PLACES, -1 - row), line) for row, line in enumerate(wrists)]
        instructions = instruction_lines(monitor)
        parts += [((WORDS, -row), line) for row, line in enumerate(instructions)]
        parts.append((None, figures(monitor)))

        # Events last: the oldest is left out first, the newest only after the poses
        events = list(monitor.events)
        for row, line in enumerate(events, 1):
            priority = (EVENTS if row == len(events) else OLD_EVENTS, row)
            parts.append((priority, Text(line, style="dim", no_wrap=True, overflow="ellipsis")))
        return parts


def _light_lines(monitor: Monitor, strips: Sequence[Strip], width: int) -> list[Text]:
    if len(strips) > MAX_STRIPS:
        return _side_by_side(monitor, strips, width)
    lines: list[Text] = []
    for strip in strips:
        lines += _strip(monitor, strip, width, _name_width(strips, width))
    return lines


def _name_width(strips: Sequence[Strip], width: int) -> int:
    longest = max(len(strip.id) for strip in strips)
    return max(NAME_WIDTH, min(longest + 1, int(0.3 * width)))


def _name(strip: Strip, width: int) -> str:
    if len(strip.id) < width:
        return f"{strip.id} "
    return f"{strip.id[: width - 2]}… "


def _strip(monitor: Monitor, strip: Strip, width: int, name_width: int) -> list[Text]:
    """Return a strip's pixels as coloured half blocks, two pixels per cell, and the cursors below."""
    pixels = pixels_along(monitor.frame, strip)
    pairs = (len(pixels) + 1) // 2
    cells = max(1, min(width - name_width, pairs))
    name = _name(strip, name_width)
    line = Text(f"{name:<{name_width}}", style="bold", no_wrap=True)
    _light(line, pixels, cells)

    marks = Text(" " * (name_width + cells), no_wrap=True)
    length_m = Polyline(strip.line_m).length_m
    cursors = sorted(monitor.cursors.items())
    for user, cursor in cursors:
        if cursor.surface == "strip" and cursor.surface_id == strip.id:
            cell = min(cells - 1, int(cursor.position_m / length_m * cells))
            symbol = "▲" if len(cursors) == 1 else user[-1]
            mark = Text(symbol, style=color_of(monitor, user))
            column = name_width + cell
            marks = Text.assemble(marks[:column], mark, marks[column + 1 :], no_wrap=True)
    return [line, marks]


def _light(line: Text, pixels: Sequence[tuple[int, int, int]], cells: int) -> None:
    columns = 2 * cells
    last = len(pixels) - 1
    pairs: list[tuple[tuple[int, int, int], tuple[int, int, int]]] = []
    for cell in range(cells):
        left = (2 * cell) * len(pixels) // columns
        right = (2 * cell + 1) * len(pixels) // columns
        pairs.append((pixels[left], pixels[min(right, last)]))
    for (left_color, right_color), run in groupby(pairs):  # fewer escape sequences: one per change of colour
        style = f"{_style(left_color)} on {_style(right_color)}"
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
        needed = GAP_WIDTH + len(name) + cells
        used = rows[-1].cell_len
        if used and used + needed > width:
            rows.append(Text(no_wrap=True))
        row = rows[-1]
        row.append(" " * GAP_WIDTH if row.cell_len else "")
        row.append(name, style="bold")
        _light(row, pixels_along(monitor.frame, strip), cells)
    return rows


def pixels_along(frame: StripsFrame | None, strip: Strip) -> list[tuple[int, int, int]]:
    """Return a strip's pixels from the start of its line to the end, in either wiring direction."""
    rgb = b""
    if frame is not None:
        rgb = _rgb_of(frame, strip.id)
    if len(rgb) < 3:
        return [(0, 0, 0)] * strip.pixels
    pixels: list[tuple[int, int, int]] = []
    for start in range(0, len(rgb) - 2, 3):
        red, green, blue = rgb[start : start + 3]
        pixels.append((red, green, blue))
    return pixels if strip.direction == 1 else pixels[::-1]


def _rgb_of(frame: StripsFrame, strip_id: str) -> bytes:
    for shown in frame.strips:
        if shown.id == strip_id:
            return shown.rgb
    return b""


def _lamps(monitor: Monitor) -> Text:
    text = Text(f"{'lamps':<{NAME_WIDTH}}", style="bold")
    for name, lamp in sorted(monitor.lamps.items()):
        is_on = any(lamp.color)
        symbol = "●" if is_on else "○"
        style = _style(lamp.color) if is_on else "dim"
        text.append(f"{symbol} {name}  ", style=style)
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
    dispensable: list[tuple[tuple[int, int], int]] = []
    for position, block in remaining.items():
        if block.priority is not None:
            dispensable.append((block.priority, position))
    dispensable.sort()
    for _, position in dispensable:
        if height <= room:
            break
        height -= len(remaining.pop(position).lines)
    lines: list[list[Segment]] = []
    for block in remaining.values():
        lines += map(list, block.lines)
    return lines


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

    def remaining_s() -> float:
        over_s = end_s()
        return 0.0 if over_s is None else max(0.0, over_s - time.monotonic())

    def drawn() -> RenderableType:
        button_of = _first_person(scenario) if has_keyboard() else ""
        is_looked_on = end_s() is not None and looks_on()
        return ConsoleView(
            scenario.monitor,
            f"PointIt {scenario.plan.name}",
            remaining_s,
            button_of,
            page=scenario.address,
            parts=parts,
            is_looked_on=is_looked_on,
        )

    # The view is left before the keyboard, so that no key is echoed into it
    live = Live(get_renderable=drawn, console=console, refresh_per_second=REFRESH_HZ, transient=True)
    with contextlib.ExitStack() as stack:
        if has_keyboard():
            stack.enter_context(keys(press))
        stack.enter_context(live)
        yield


def _first_person(scenario: RunningScenario) -> str:
    return next(iter(scenario.plan.users), "")
