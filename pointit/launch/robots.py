"""Observation of robots in a run: their states for the view, event lines about their users, their score."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, cast

from pointit.geometry.floor_area import FloorArea
from pointit.geometry.vector import Vec3
from pointit.launch.plan.plan import OnEvent
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.service.service import Launch
from pointit.schemas import Environment, Goal, RobotState
from pointit.schemas.environment import Fence
from pointit.schemas.text import all_of
from pointit.schemas.topics import GOAL, ROBOT_STATE
from pointit.services.user_sim.config import UserSimConfig
from pointit.site.following import follow_topics
from pointit.site.site_state import Change, SiteState

MAX_ROBOTS = 64
"""Robots scored individually; further ones are ignored."""
MAX_LANDINGS = 1000
"""Landings of one robot that are stored. Later ones are only counted."""
ARRIVED_M = 0.3
"""Distance from a goal within which it was reached."""


def spots_of(launches: Sequence[Launch]) -> tuple[Vec3, ...]:
    """Return the places to which the simulated people of a run steer robots, {W}."""
    spots_m: list[Vec3] = []
    for launch in launches:
        if isinstance(launch.config, UserSimConfig):
            spots_m += launch.config.spots_m
    return tuple(spots_m)


@dataclass
class SteeringScore:
    """Results of one person with one robot."""

    landed_off_m: list[float] = field(default_factory=list[float])
    """Horizontal distance of each landing from the nearest of the spots, or from where it was sent."""
    landings: int = 0
    goals: int = 0
    reached_off_m: list[float] = field(default_factory=list[float])
    """Horizontal distance from each goal that was reached."""
    goals_reached: int = 0

    def add(self, off_m: float, *, is_landing: bool) -> None:
        """Count a landing or a goal that was reached, `off_m` from it, infinite if unknown."""
        self.landings += is_landing
        self.goals_reached += not is_landing
        distances_m = self.landed_off_m if is_landing else self.reached_off_m
        if len(distances_m) < MAX_LANDINGS and math.isfinite(off_m):
            distances_m.append(round(off_m, 3))


@dataclass
class RobotScore:
    """Counts of one robot."""

    people: dict[str, SteeringScore] = field(default_factory=dict[str, SteeringScore])
    """By the person who steered it last, or `""` if unknown."""
    fences_crossed: int = 0
    """Number of times that its centre crossed a fence."""

    def as_dict(self) -> dict[str, Any]:
        """Return it for the summary."""
        landings = 0
        goals = 0
        goals_reached = 0
        landed_off_m: list[float] = []
        for person in self.people.values():
            landed_off_m += person.landed_off_m
            landings += person.landings
            goals += person.goals
            goals_reached += person.goals_reached
        people = {user: asdict(person) for user, person in sorted(self.people.items())}
        return {
            "landings": landings,
            "landed_off_m": landed_off_m,
            "goals": goals,
            "goals_reached": goals_reached,
            "fences_crossed": self.fences_crossed,
            "people": people,
        }


class RobotsScore:
    """Scores all robots from their states; pure."""

    def __init__(self, spots_m: Sequence[Vec3] = ()) -> None:
        """Start without robots. `spots_m`: places where simulated people land them, {W}, `()` if unknown."""
        self._spots_m = spots_m
        self._fences: tuple[Fence, ...] = ()
        self._areas: dict[str, FloorArea] = {}
        self._previous: dict[str, RobotState] = {}
        self._outside: dict[str, frozenset[str]] = {}
        self._sent_m: dict[str, Vec3] = {}
        """Position to which each robot was last sent."""
        self._users: dict[str, str] = {}
        """Person who last steered each robot."""
        self.unclaimed: dict[str, list[tuple[float, float, float]]] = {}
        """Position and its 1 sigma, m, of goals that are for no robot of the site, by person."""
        self.robots: dict[str, RobotScore] = {}
        """Score of each robot."""

    def on_map(self, environment: Environment) -> None:
        """Update the fences."""
        self._fences = environment.fences
        self._areas = {fence.id: FloorArea(fence.outline_m) for fence in environment.fences}
        self._outside.clear()

    def on_goal(self, goal: Goal, user: str = "") -> None:
        """Store the position to which `user` sends a robot."""
        if goal.robot in self.robots:
            self._sent_m[goal.robot] = goal.position_m
            self._users[goal.robot] = user or self._users.get(goal.robot, "")
        elif len(self.unclaimed) < MAX_ROBOTS or user in self.unclaimed:
            goals = self.unclaimed.setdefault(user, [])
            x_m, y_m, _ = goal.position_m
            del goals[: -MAX_LANDINGS + 1]
            sigma_m = round(goal.position_sigma_m, 3)
            goals.append((round(x_m, 2), round(y_m, 2), sigma_m))

    def on_state(self, robot: str, state: RobotState) -> None:
        """Update from a state of `robot`."""
        score = self.robots.get(robot)
        if score is None:
            if len(self.robots) >= MAX_ROBOTS:
                return
            score = RobotScore()
            self.robots[robot] = score

        # a robot that begins outside has crossed nothing
        if state.phase != "lost":
            crossed = self._crossed(state.position_m)
            score.fences_crossed += len(crossed - self._outside.get(robot, crossed))
            self._outside[robot] = crossed
        # A robot without a person flies on for the last one
        self._users[robot] = state.user or self._users.get(robot, "")
        person = score.people.setdefault(self._users[robot], SteeringScore())
        previous = self._previous.get(robot)
        self._previous[robot] = state
        if previous is None:
            return
        if state.target_m is not None:
            self._sent_m[robot] = state.target_m
        if state.phase == "landed" and previous.phase == "landing":
            person.add(self._landed_off_m(robot, state.position_m), is_landing=True)

        # The goal is over if another one, or none, follows: reached if the robot is there
        if previous.goal_ns not in (0, state.goal_ns):
            off_m = self._away_m(robot, state.position_m)
            if off_m <= ARRIVED_M:
                person.add(off_m, is_landing=False)
        person.goals += state.goal_ns not in (0, previous.goal_ns)

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return the scores by robot, for the summary."""
        return {name: score.as_dict() for name, score in sorted(self.robots.items())}

    @property
    def goals_without_robot(self) -> dict[str, list[tuple[float, float, float]]]:
        """Return `unclaimed` if no robot is known, as any robot may take them, else nothing."""
        return {} if self.robots else self.unclaimed

    def _landed_off_m(self, robot: str, position_m: Vec3) -> float:
        away_m = self._away_m(robot, position_m)
        distances_m = [math.dist(position_m[:2], spot_m[:2]) for spot_m in self._spots_m]
        return min(distances_m, default=away_m)

    def _away_m(self, robot: str, position_m: Vec3) -> float:
        sent_m = self._sent_m.get(robot)
        if sent_m is None:
            return math.inf
        return math.dist(position_m[:2], sent_m[:2])

    def _crossed(self, position_m: Vec3) -> frozenset[str]:
        crossed = set[str]()
        for fence in self._fences:
            should_be_in = fence.kind == "keep_in"
            if self._is_in(fence, position_m) != should_be_in:
                crossed.add(fence.id)
        return frozenset(crossed)

    def _is_in(self, fence: Fence, position_m: Vec3) -> bool:
        x, y, z = position_m
        is_above = fence.low_m is None or z >= fence.low_m
        is_below = fence.high_m is None or z <= fence.high_m
        if not is_above or not is_below:
            return False
        return self._areas[fence.id].contains((x, y))


def score_lines(robots: dict[str, dict[str, Any]]) -> list[str]:
    """Return one sentence for each robot that landed, had a goal or crossed a fence."""
    lines: list[str] = []
    for name, score in robots.items():
        actions: list[str] = []
        for user, person in score["people"].items():
            actions += _person_lines(user, person)
        if score["fences_crossed"]:
            actions.append(f"crossed fences {_times(score['fences_crossed'])}")
        if actions:
            lines.append(f"{name} {'; '.join(actions)}.")
    return lines


def _person_lines(user: str, score: Mapping[str, Any]) -> list[str]:
    lines: list[str] = []
    if score["landings"]:
        person = f" for {user}" if user else ""
        accuracy = _off(score["landed_off_m"], "the place")
        lines.append(f"landed {_times(score['landings'])}{person}{accuracy}")
    if score["goals"]:
        person = ""
        if user:
            accuracy = _off(score["reached_off_m"], "them")
            person = f" of {user}{accuracy}"
        reached = score["goals_reached"]
        lines.append(f"reached {reached} of {score['goals']} goals{person}")
    return lines


def _off(distances_m: Sequence[float], target: str) -> str:
    if not distances_m:
        return ""
    shown = _distances([f"{distance_m:.2f}" for distance_m in distances_m])
    return f", {shown} m from {target}"


def goal_lines(goals: Mapping[str, Sequence[Sequence[float]]]) -> list[str]:
    """Return one sentence for each person whose goals no robot could reach, with the last of them."""
    lines: list[str] = []
    for user, sent in sorted(goals.items()):
        x_m, y_m, _ = sent[-1]
        max_sigma_m = max(goal[2] for goal in sent)
        lines.append(
            f"{user} sent a robot {_times(len(sent))}, last to {x_m:.2f}, {y_m:.2f} m "
            f"(1 sigma {max_sigma_m:.2f} m at most); none drives here."
        )
    return lines


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _distances(words: Sequence[str]) -> str:
    """Return numbers as text, or the median and the largest of more than eight."""
    if len(words) > 8:
        numbers = sorted(float(word) for word in words)
        median = numbers[len(numbers) // 2]
        return f"median {median:.2f}, largest {numbers[-1]:.2f}"
    return all_of(words)


class RobotWatcher:
    """A `Watcher` of all robots of a site."""

    def __init__(self, score: RobotsScore | None = None) -> None:
        """Begin without robots."""
        self.score = score or RobotsScore()
        self.site = SiteState(self._on_change)
        self.states = self.site.all(ROBOT_STATE)
        self._on_event: OnEvent | None = None

    @classmethod
    def of(cls, launches: Sequence[Launch]) -> "RobotWatcher":
        """Return the watcher of a scenario; its simulated people state where they land robots."""
        return cls(RobotsScore(spots_of(launches)))

    def attach(self, bus: Bus, on_event: OnEvent) -> Sequence[Closable]:
        """Subscribe to robots and their goals."""
        self._on_event = on_event
        states = follow_topics(self.site, bus, time.monotonic, (ROBOT_STATE,))
        return (*states, bus.subscribe(GOAL, self.score.on_goal))

    def on_map(self, environment: Environment) -> None:
        """Store the fences."""
        self.score.on_map(environment)

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Forget the robot of a service that has ended."""
        self.site.set_service(instance, present=is_present)

    def summary(self) -> Mapping[str, Any]:
        """Return the scores by robot."""
        return {"robots": self.score.as_dict(), "goals_without_robot": self.score.goals_without_robot}

    def _on_change(self, change: Change) -> None:
        """Report each change of a robot's user and of its reason."""
        name = change.name
        state = change.message
        previous = cast("RobotState | None", change.previous)
        if not isinstance(state, RobotState):
            return
        self.score.on_state(name, state)
        if self._on_event is None:
            return
        previous_user = "" if previous is None else previous.user
        if state.user != previous_user:
            person = state.user or "nobody"
            self._on_event(f"{name}: {person} steers it", state.user)
        if state.has_new_reason(previous):
            self._on_event(f"{name}: {state.reason}", state.user)
