"""Robots as a run observes them: their states for the view, event lines on who steers them, their score."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from pointit.launch.plan.watcher import News
from pointit.launch.robots.robot_score import RobotsScore, spots_of
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.service.service import Launch
from pointit.schemas import Environment, RobotState
from pointit.schemas.system import split_instance
from pointit.schemas.topics import GOAL, ROBOT_STATE

_NUMBER = re.compile(r"\d+(?:\.\d+)?")


class RobotWatcher:
    """A `Watcher` of all robots of a site."""

    def __init__(self, score: RobotsScore | None = None) -> None:
        """Begin without robots."""
        self.score = score or RobotsScore()
        self.monitor = RobotMonitor()

    @classmethod
    def of(cls, launches: Sequence[Launch]) -> "RobotWatcher":
        """Return the watcher of a scenario; simulated people in it tell where they land robots."""
        return cls(RobotsScore(spots_of(launches)))

    def attach(self, bus: Bus, news: News) -> Sequence[Closable]:
        """Subscribe to robots and their goals."""

        def on_state(state: RobotState, robot: str) -> None:
            self.score.on_state(robot, state)
            for line in self.monitor.take(state, robot):
                news(line, state.user)

        return (
            bus.subscribe(ROBOT_STATE, on_state),
            bus.subscribe(GOAL, lambda goal, _user: self.score.on_goal(goal)),
        )

    def on_map(self, environment: Environment) -> None:
        """Take the fences."""
        self.score.on_map(environment)

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Forget the robot of a service that has ended."""
        if not is_present:
            self.monitor.end(instance)

    def summary(self) -> Mapping[str, Any]:
        """Return the scores by robot."""
        return {"robots": self.score.as_dict()}


class RobotMonitor:
    """Holds the states; those of a robot whose service has ended are forgotten."""

    def __init__(self) -> None:
        """Begin without robots."""
        self.states: dict[str, RobotState] = {}
        """By name of the robot."""

    def take(self, state: RobotState, name: str) -> list[str]:
        """Store a state, and return an event line for each change of who steers it and of its reason.

        A reason with other figures is the same one.
        """
        before = self.states.get(name)
        self.states[name] = state
        lines: list[str] = []
        if state.user != ("" if before is None else before.user):
            lines.append(f"{name}: {state.user or 'nobody'} steers it")
        told = "" if before is None else before.reason
        if state.reason and _NUMBER.sub("#", state.reason) != _NUMBER.sub("#", told):
            lines.append(f"{name}: {state.reason}")
        return lines

    def end(self, instance: str) -> None:
        """Forget the robot of a service that has ended."""
        service, name = split_instance(instance)
        if service in ROBOT_STATE.writers:
            self.states.pop(name, None)
