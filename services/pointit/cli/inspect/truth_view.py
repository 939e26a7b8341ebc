"""Errors of people's poses in the terminal view, where motion capture knows the true ones."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from pointit.cli.display.display_part import DisplayPart
from pointit.cli.display.people_view import color_of
from pointit.launch.run.monitor import Monitor
from pointit.services.localizer.certainty import figure


def no_rows(_monitor: Monitor, _width: int) -> RenderableType | None:
    """Return None: errors are lines."""
    return None


def error_lines(monitor: Monitor) -> Sequence[Text]:
    """Return a line for each person whose pose is compared with the true one."""
    lines: list[Text] = []
    for health in monitor.health.values():
        for user in monitor.people():
            position_m = figure(health, f"position error of {user}"[:64])
            if position_m is None:
                continue
            yaw_deg = figure(health, f"yaw error of {user}"[:64])
            text = f"{position_m:.2f} m" if yaw_deg is None else f"{position_m:.2f} m, {yaw_deg:+.1f}°"
            lines.append(Text.assemble((f"{user}: ", color_of(monitor, user)), f"error of the pose {text}"))
    return lines


def no_summary(_summary: Mapping[str, Any]) -> Sequence[str]:
    """Return no sentences."""
    return ()


TRUTH_DISPLAY = DisplayPart(rows=no_rows, lines=error_lines, summary=no_summary)
