"""Errors of localized poses where a tracker sees the true ones, over a window, and in the terminal view."""

import math
from dataclasses import asdict, dataclass

from rich.console import Console, RenderableType
from rich.text import Text

from pointit.cli.common.output import OutputSection, print_table
from pointit.cli.summary import DisplayPart
from pointit.cli.view import color_of
from pointit.diagnosis.symptoms import figure
from pointit.forearm.true_pose import find_true_poses
from pointit.launch.run.monitor import Monitor
from pointit.schemas import Message, TrackedObjects, UserPose

MAX_METRIC = 64
"""Number of characters to which names of metrics are cut."""


@dataclass(frozen=True, kw_only=True)
class TruthRow:
    """Difference of a person's localized pose from the one that a tracker sees."""

    person: str
    position_error_m: float | None
    """None if they are not localized."""
    yaw_error_deg: float | None
    """Localized less true yaw. None if the true one is not known."""
    true_yaw_deg: float | None


class PoseErrors:
    """Collects true and localized poses."""

    def __init__(self) -> None:
        self._tracked: dict[str, TrackedObjects] = {}
        self._poses: dict[str, UserPose] = {}

    def add(self, message: Message, name: str) -> None:
        """Add objects of the tracker, or the pose of the person, `name`. Other messages do not count."""
        if isinstance(message, TrackedObjects):
            self._tracked[name] = message
        elif isinstance(message, UserPose):
            self._poses[name] = message

    def take(self) -> tuple[TruthRow, ...]:
        """Return the newest errors by person, and start the next window: a silent tracker knows no truth."""
        rows: list[TruthRow] = []
        for person, true_pose in sorted(find_true_poses(self._tracked).items()):
            position_error_m: float | None = None
            yaw_error_deg: float | None = None
            pose = self._poses.get(person)
            error = None if pose is None else true_pose.error_of(pose)
            if error is not None:
                position_error_m = error.position_m
                yaw_error_deg = _degrees(error.yaw_rad)
            row = TruthRow(
                person=person,
                position_error_m=position_error_m,
                yaw_error_deg=yaw_error_deg,
                true_yaw_deg=_degrees(true_pose.yaw_rad),
            )
            rows.append(row)
        self._tracked.clear()
        return tuple(rows)


def print_errors(console: Console, rows: tuple[TruthRow, ...]) -> None:
    """Print a table of `rows`, or nothing if there are none."""
    if not rows:
        return
    shown = tuple(asdict(row) for row in rows)
    section = OutputSection(name="truth", about="localized pose less the true one", rows=shown)
    print_table(console, section)


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else math.degrees(angle_rad)


def error_lines(monitor: Monitor, _width: int) -> RenderableType | None:
    """Return a line for each person whose pose is compared with the true one, or None if there is none."""
    lines: list[Text] = []
    for health in monitor.health.values():
        for user in monitor.people():
            position_m = figure(health, f"position error of {user}"[:MAX_METRIC])
            yaw_deg = figure(health, f"yaw error of {user}"[:MAX_METRIC])
            if position_m is None:
                continue
            text = f"error of the pose {position_m:.2f} m"
            if yaw_deg is not None:
                text += f", {yaw_deg:+.1f}°"
            name = (f"{user}: ", color_of(monitor, user))
            lines.append(Text.assemble(name, text))
    return Text("\n").join(lines) if lines else None


TRUTH_DISPLAY = DisplayPart(rows=error_lines)
