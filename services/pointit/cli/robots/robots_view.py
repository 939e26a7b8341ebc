"""Robots in the terminal view: user, activity, goal, and reason to stand."""

from collections.abc import Mapping
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from pointit.cli.display.display_part import DisplayPart
from pointit.cli.display.people_view import ROOMY_WIDTH, color_of
from pointit.launch.robots.robot_watcher import RobotWatcher, goal_lines, score_lines
from pointit.launch.run.monitor import Monitor
from pointit.schemas import RobotState


def robot_lines(monitor: Monitor, width: int) -> RenderableType | None:
    """Return a row for each robot in columns of constant width, or None if none is known."""
    robots = _robots(monitor)
    if not robots:
        return None
    is_roomy = width >= ROOMY_WIDTH
    columns = [("robot", 6), ("steered by", 10), ("phase", 10), ("target", 14)]
    if is_roomy:
        columns += [("at", 18), ("battery", 7)]
    table = Table(box=None, padding=(0, 2 if is_roomy else 1, 0, 0), header_style="dim")
    for column, least in columns:
        table.add_column(column, no_wrap=True, min_width=least)
    for name, state in robots:
        x_m, y_m, z_m = state.position_m
        cells = [
            Text(name, style="bold"),
            Text(state.user or "-", style=color_of(monitor, state.user) if state.user else ""),
            Text(state.phase.replace("_", " "), style="yellow" if state.phase in ("stopped", "lost") else ""),
            Text("-" if state.target_m is None else "{:.1f}, {:.1f} m".format(*state.target_m[:2])),
            Text(f"{x_m:.1f}, {y_m:.1f}, {z_m:.1f} m"),
            Text("-" if state.battery is None else f"{state.battery:.0%}"),
        ]
        table.add_row(*cells[: len(columns)])
    return table


def reason_lines(monitor: Monitor) -> list[Text]:
    """Return a line with the reason of each robot that does not move as asked."""
    return [
        Text.assemble((f"{name}: ", "bold"), (state.reason, "yellow"))
        for name, state in _robots(monitor)
        if state.reason
    ]


def _robots(monitor: Monitor) -> list[tuple[str, RobotState]]:
    """Return the robots; in the view of one person, theirs and those that nobody steers."""
    return [
        (name, state)
        for watcher in monitor.watchers
        if isinstance(watcher, RobotWatcher)
        for name, state in sorted(watcher.monitor.states.items())
        if not monitor.person or state.user in ("", monitor.person)
    ]


def _summary(summary: Mapping[str, Any]) -> list[str]:
    return score_lines(summary.get("robots", {})) + goal_lines(summary.get("goals_without_robot", {}))


ROBOTS_DISPLAY = DisplayPart(rows=robot_lines, lines=reason_lines, summary=_summary)
