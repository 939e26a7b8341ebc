"""Errors of people's poses in the terminal view, where motion capture knows the true ones."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from pointit.cli.display.display_part import DisplayPart
from pointit.cli.display.people_view import color_of
from pointit.diagnosis.certainty import figure
from pointit.launch.run.monitor import Monitor

MAX_METRIC = 64
"""Number of characters to which names of metrics are cut."""


def error_lines(monitor: Monitor, _width: int) -> RenderableType | None:
    """Return a line for each person whose pose is compared with the true one, or None if there is none."""
    lines: list[Text] = []
    for health in monitor.health.values():
        for user in monitor.people():
            position_m = figure(health, f"position error of {user}"[:MAX_METRIC])
            yaw_deg = figure(health, f"yaw error of {user}"[:MAX_METRIC])
            if position_m is not None:
                text = f"error of the pose {position_m:.2f} m"
                text += "" if yaw_deg is None else f", {yaw_deg:+.1f}°"
                lines.append(Text.assemble((f"{user}: ", color_of(monitor, user)), text))
    return Text("\n").join(lines) if lines else None


def more_lines(_monitor: Monitor) -> Sequence[Text]:
    """Return no further lines."""
    return ()


def summary_sentences(_summary: Mapping[str, Any]) -> Sequence[str]:
    """Return no sentences."""
    return ()


TRUTH_DISPLAY = DisplayPart(rows=error_lines, lines=more_lines, summary=summary_sentences)
