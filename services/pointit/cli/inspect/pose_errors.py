"""Errors of localized poses where a tracker sees the true ones, over a window."""

import math
from dataclasses import asdict, dataclass

from rich.console import Console

from pointit.cli.common.output import OutputSection, print_table
from pointit.forearm.true_pose import find_true_poses
from pointit.schemas import Message, TrackedObjects, UserPose


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
            pose = self._poses.get(person)
            error = None if pose is None else true_pose.error_of(pose)
            rows.append(
                TruthRow(
                    person=person,
                    position_error_m=None if error is None else error.position_m,
                    yaw_error_deg=None if error is None else _degrees(error.yaw_rad),
                    true_yaw_deg=_degrees(true_pose.yaw_rad),
                )
            )
        self._tracked.clear()
        return tuple(rows)


def print_errors(console: Console, rows: tuple[TruthRow, ...]) -> None:
    """Print a table of `rows`, or nothing if there are none."""
    if rows:
        shown = tuple(asdict(row) for row in rows)
        print_table(
            console, OutputSection(name="truth", about="localized pose less the true one", rows=shown)
        )


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else math.degrees(angle_rad)
