"""The terminal view: strips in their real colours, cursors, people, rates and latency."""

import time
from collections.abc import Callable
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from pointit.cli.monitor import Monitor
from pointit.geometry.polyline import Polyline
from pointit.schemas import Strip, StripsFrame
from pointit.schemas.topics import CURSOR, IMU, RAY, STRIPS_FRAME, Topic

REFRESH_HZ = 8
"""The view is drawn in a thread of its own, this often."""
NAME_WIDTH = 8
SHOWN_RATES: dict[str, Topic[Any]] = {"imu": IMU, "ray": RAY, "cursor": CURSOR, "frame": STRIPS_FRAME}
"""Topics whose rates are shown, the chain from wrist to light."""


def draw(monitor: Monitor, title: str, remaining_s: Callable[[], float]) -> RenderableType:
    """Return the whole view of what `monitor` holds now."""
    parts: list[RenderableType] = []
    if monitor.environment is not None:
        width = max(20, Console().width - NAME_WIDTH - 8)
        for strip in monitor.environment.strips:
            parts.extend(_strip(monitor, strip, width))
        if monitor.lamps:
            parts.append(_lamps(monitor))
    else:
        parts.append(Text("waiting for the map …", style="dim"))
    parts.append(_people(monitor))
    parts.append(_figures(monitor))
    parts.extend(Text(line, style="dim", no_wrap=True) for line in list(monitor.events))
    left = remaining_s()
    subtitle = f"{left:.0f} s left, Ctrl-C ends it" if left > 0 else "Ctrl-C ends it"
    return Panel(Group(*parts), title=title, subtitle=subtitle, border_style="cyan")


def _strip(monitor: Monitor, strip: Strip, width: int) -> list[Text]:
    """Return a strip's pixels as coloured half blocks, two pixels a cell, and below them the cursors."""
    pixels = pixels_along(monitor.frame, strip)
    cells = min(width, (len(pixels) + 1) // 2)
    line = Text(f"{strip.id:<{NAME_WIDTH}.{NAME_WIDTH}}", style="bold", no_wrap=True)
    columns = 2 * cells
    for cell in range(cells):
        left = pixels[(2 * cell) * len(pixels) // columns]
        right = pixels[min((2 * cell + 1) * len(pixels) // columns, len(pixels) - 1)]
        line.append("▌", style=f"rgb({left[0]},{left[1]},{left[2]}) on rgb({right[0]},{right[1]},{right[2]})")
    marks = [" "] * cells
    length = Polyline(strip.line_m).length_m
    for user, cursor in list(monitor.cursors.items()):
        if cursor.surface == "strip" and cursor.surface_id == strip.id:
            cell = min(cells - 1, int(cursor.position_m / length * cells))
            marks[cell] = "▲" if len(monitor.cursors) == 1 else user[-1]
    return [line, Text(" " * NAME_WIDTH + "".join(marks), no_wrap=True)]


def pixels_along(frame: StripsFrame | None, strip: Strip) -> list[tuple[int, int, int]]:
    """Return a strip's pixels from the start of its line to the end, whatever its direction."""
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


def _people(monitor: Monitor) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=True, header_style="dim")
    for column in ("person", "state", "cursor", "object", "progress", "next step"):
        table.add_column(column, no_wrap=column != "next step")
    for user in sorted(set(monitor.interactions) | set(monitor.cursors)):
        interaction = monitor.interactions.get(user)
        cursor = monitor.cursors.get(user)
        hover = monitor.hovers.get(user)
        where = "-"
        if cursor is not None and cursor.surface != "none":
            where = f"{cursor.surface} {cursor.surface_id} at {cursor.position_m:.2f} m"
        kind = monitor.score.kinds.get(hover.object_id, "") if hover is not None and hover.object_id else ""
        filled = round(10 * hover.progress) if hover is not None and hover.object_id else 0
        table.add_row(
            user,
            interaction.state if interaction is not None else "pointing",
            where,
            kind or "-",
            "█" * filled + "░" * (10 - filled),
            interaction.next_step if interaction is not None else "",
        )
    return table


def _figures(monitor: Monitor) -> Text:
    parts: list[str] = []
    latency = monitor.latency.quantiles_ms()
    if latency["p50"] is not None:
        parts.append(f"wrist to light p50 {latency['p50']:.1f} ms, p99 {latency['p99']:.1f} ms")
    rates: dict[str, float] = {}
    for health in list(monitor.health.values()):
        for key in health.keys:
            if key.direction == "out" and key.rate_hz > 0:
                rates[key.key] = rates.get(key.key, 0.0) + key.rate_hz
    parts += [
        f"{name} {rates[topic.key]:.0f} Hz" for name, topic in SHOWN_RATES.items() if topic.key in rates
    ]
    if monitor.score.target_kinds:
        counts: dict[str, Any] = monitor.score.counts()
        parts.append(f"selected {counts['selected']}, missed {counts['missed']}, wrong {counts['wrong']}")
    now_ns = time.time_ns()
    ill = [
        name
        for name, health in list(monitor.health.items())
        if health.warnings or now_ns - health.stamp_ns > 3_000_000_000
    ]
    text = Text(" · ".join(parts))
    if ill:
        text.append(f"  look at: {', '.join(sorted(ill))} (pointit doctor)", style="yellow")
    return text
