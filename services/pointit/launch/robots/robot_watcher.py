"""Robots as a run observes them: their states for the view, event lines on who steers them, their score."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pointit.geometry.polygon import Polygon
from pointit.geometry.vector import Vec3
from pointit.launch.plan.watcher import News
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.service.service import Launch
from pointit.schemas import Environment, Goal, RobotState
from pointit.schemas.environment import Fence
from pointit.schemas.system import split_instance
from pointit.schemas.topics import GOAL, ROBOT_STATE
from pointit.services.user_sim.config import UserSimConfig

_NUMBER = re.compile(r"\d+(?:\.\d+)?")
MAX_ROBOTS = 64
"""Robots scored individually; further ones are ignored."""
MAX_LANDINGS = 1000
"""Landings of one robot that are stored. Later ones are only counted."""
ARRIVED_M = 0.3
"""Distance from a goal within which it was reached."""


def spots_of(launches: Sequence[Launch]) -> tuple[Vec3, ...]:
    """Return the places to which the simulated people of a run steer robots, {W}."""
    configs = (launch.config for launch in launches)
    return tuple(spot for config in configs if isinstance(config, UserSimConfig) for spot in config.spots_m)


@dataclass
class RobotScore:
    """Counts of one robot."""

    landings: int = 0
    landed_off_m: list[float] = field(default_factory=list[float])
    """Horizontal distance of each landing from the nearest of the spots, or from where it was sent."""
    goals: int = 0
    """Goals that it began."""
    goals_reached: int = 0
    fences_crossed: int = 0
    """Number of times that its centre crossed a fence."""

    def as_dict(self) -> dict[str, Any]:
        """Return it for the summary."""
        off_m = [round(each, 3) for each in self.landed_off_m]
        return {
            "landings": self.landings,
            "landed_off_m": off_m,
            "goals": self.goals,
            "goals_reached": self.goals_reached,
            "fences_crossed": self.fences_crossed,
        }


class RobotsScore:
    """Scores all robots from their states; pure."""

    def __init__(self, spots_m: Sequence[Vec3] = ()) -> None:
        """Start without robots. `spots_m`: places where simulated people land them, {W}, `()` if unknown."""
        self._spots_m = spots_m
        self._fences: tuple[Fence, ...] = ()
        self._areas: dict[str, Polygon] = {}
        self._before: dict[str, RobotState] = {}
        self._outside: dict[str, frozenset[str]] = {}
        self._sent_m: dict[str, Vec3] = {}
        """Place where each robot was last sent to."""
        self.robots: dict[str, RobotScore] = {}
        """Score of each robot."""

    def on_map(self, environment: Environment) -> None:
        """Update the fences."""
        self._fences = environment.fences
        self._areas = {fence.id: Polygon(fence.outline_m) for fence in environment.fences}
        self._outside.clear()

    def on_goal(self, goal: Goal) -> None:
        """Note where a robot is sent to."""
        if goal.robot in self.robots:
            self._sent_m[goal.robot] = goal.position_m

    def on_state(self, robot: str, state: RobotState) -> None:
        """Update from a state of `robot`."""
        score = self.robots.get(robot)
        if score is None:
            if len(self.robots) >= MAX_ROBOTS:
                return
            score = self.robots[robot] = RobotScore()
        if state.phase != "lost":
            crossed = self._crossed(state.position_m)
            score.fences_crossed += len(crossed - self._outside.get(robot, crossed))
            self._outside[robot] = crossed
        before = self._before.get(robot)
        self._before[robot] = state
        if before is None:
            return
        if state.target_m is not None:
            self._sent_m[robot] = state.target_m
        if state.phase == "landed" and before.phase == "landing":
            self._landed(robot, score, state.position_m)
        if state.goal_ns not in (0, before.goal_ns):
            score.goals += 1
        is_done = before.goal_ns not in (0, state.goal_ns)
        if is_done and self._away_m(robot, state.position_m) <= ARRIVED_M:
            score.goals_reached += 1

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return the scores by robot, for the summary."""
        return {name: score.as_dict() for name, score in sorted(self.robots.items())}

    def _landed(self, robot: str, score: RobotScore, position_m: Vec3) -> None:
        score.landings += 1
        off_m = min(
            (math.dist(position_m[:2], spot_m[:2]) for spot_m in self._spots_m),
            default=self._away_m(robot, position_m),
        )
        if len(score.landed_off_m) < MAX_LANDINGS and math.isfinite(off_m):
            score.landed_off_m.append(off_m)

    def _away_m(self, robot: str, position_m: Vec3) -> float:
        sent_m = self._sent_m.get(robot)
        return math.inf if sent_m is None else math.dist(position_m[:2], sent_m[:2])

    def _crossed(self, position_m: Vec3) -> frozenset[str]:
        return frozenset(
            fence.id for fence in self._fences if self._is_in(fence, position_m) != (fence.kind == "keep_in")
        )

    def _is_in(self, fence: Fence, position_m: Vec3) -> bool:
        x, y, z = position_m
        is_between = (fence.low_m is None or z >= fence.low_m) and (fence.high_m is None or z <= fence.high_m)
        return is_between and self._areas[fence.id].contains((x, y))


def score_lines(robots: dict[str, dict[str, Any]]) -> list[str]:
    """Return one sentence for each robot that landed, had a goal or crossed a fence."""
    lines: list[str] = []
    for name, score in robots.items():
        did: list[str] = []
        if score["landings"]:
            off = [f"{each:.2f}" for each in score["landed_off_m"]]
            where = f", {_listed(off)} m from the place" if off else ""
            did.append(f"landed {_times(score['landings'])}{where}")
        if score["goals"]:
            did.append(f"reached {score['goals_reached']} of {score['goals']} goals")
        if score["fences_crossed"]:
            did.append(f"crossed fences {_times(score['fences_crossed'])}")
        if did:
            lines.append(f"{name} {'; '.join(did)}.")
    return lines


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _listed(words: Sequence[str]) -> str:
    if len(words) > 8:
        numbers = sorted(float(word) for word in words)
        return f"median {numbers[len(numbers) // 2]:.2f}, largest {numbers[-1]:.2f}"
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


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
