"""The parts of a run that optional rooms bring: all there are, each with the rooms that it needs."""

from collections.abc import Sequence

from pointit.launch.plan.plan import MakeWatcher
from pointit.runtime.host.extras import Part


def _robots() -> MakeWatcher:
    from pointit.launch.robots.robot_watcher import RobotWatcher  # noqa: PLC0415 - only if the room is there

    return RobotWatcher.of


WATCHERS: Sequence[Part[MakeWatcher]] = ((("pointit.launch.robots", "pointit.services.user_sim"), _robots),)
"""Factories of the observers and scores of a run."""
