"""The parts of a run that optional rooms bring: all there are, each with the rooms that it needs."""

from pointit.launch.plan.plan import MakeWatcher
from pointit.runtime.host.extras import OptionalPart

WATCHERS: tuple[OptionalPart[MakeWatcher], ...] = (
    OptionalPart("pointit.launch.robots:RobotWatcher.of", ("pointit.services.user_sim",)),
)
"""Factories of the observers and scores of a run."""
