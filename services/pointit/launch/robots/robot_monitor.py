"""Newest state of each robot, and event lines on who steers it and why it stands. Pure."""

import re

from pointit.schemas import RobotState
from pointit.schemas.system import split_instance
from pointit.schemas.topics import ROBOT_STATE

_NUMBER = re.compile(r"\d+(?:\.\d+)?")


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
