"""Plays scenarios with robots and several people, on a bus in memory, in virtual time."""

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from pointit.geometry.vector import Vec3
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import Scenario, read_scenario
from pointit.launch.robots import RobotsScore, RobotWatcher
from pointit.launch.run.monitor import Monitor, RunScore
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import Feedback, Goal, RobotState
from pointit.schemas.topics import FEEDBACK, GOAL, ROBOT_STATE
from pointit.services.user_sim.person import SimulatedPerson
from tests.integration.scenario.play import running, watched_people, with_fresh_state

STEP_S = 1.0
"""Time after which it is looked whether the play is over."""


@dataclass
class Flights:
    """Record of the robots' movements and people's cues."""

    robots: RobotsScore = field(default_factory=RobotsScore)
    landed_off_m: list[float] = field(default_factory=list[float])
    """Distance of each landing from the spot that the person meant."""
    sent_off_m: list[float] = field(default_factory=list[float])
    """Distance of each goal from the spot that the person meant."""
    cues: list[tuple[str, Feedback]] = field(default_factory=list[tuple[str, Feedback]])
    """Person and cue."""
    owners: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    """Robot and person, or nobody, at each change."""
    nearest_m: float = math.inf
    """Least distance of a robot in motion from a person, level."""
    phases: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    """Robots, and what each did."""
    heights_m: dict[str, float] = field(default_factory=dict[str, float])
    """Greatest height of each robot."""
    _states: dict[str, RobotState] = field(default_factory=dict[str, RobotState])

    def texts(self, user: str) -> list[str]:
        return [cue.text for name, cue in self.cues if name == user]

    def on_state(self, robot: str, state: RobotState, people: dict[str, SimulatedPerson]) -> None:
        before = self._states.get(robot)
        self._states[robot] = state
        self.heights_m[robot] = max(self.heights_m.get(robot, 0.0), state.position_m[2])
        self.phases.add((robot, state.phase))
        if state.user != ("" if before is None else before.user):
            self.owners.append((robot, state.user))
        if state.phase in {"moving", "landing", "taking_off"}:
            apart = (math.dist(state.position_m[:2], each.position_m[:2]) for each in people.values())
            self.nearest_m = min(self.nearest_m, *apart)
        is_down = before is not None and before.phase == "landing" and state.phase == "landed"
        if before is not None and is_down and before.user:
            self.landed_off_m.append(_off_m(people[before.user], state.position_m))

    def on_goal(self, goal: Goal, person: SimulatedPerson) -> None:
        self.sent_off_m.append(_off_m(person, goal.position_m))


def _off_m(person: SimulatedPerson, place_m: Vec3) -> float:
    """Return the distance of a place from where the person means to point, level."""
    meant_m = person.goal.point_m
    return math.inf if meant_m is None else math.dist(place_m[:2], meant_m[:2])


def play_robots(
    scenario: str | Scenario,
    duration_s: float,
    *,
    seed: int = 0,
    users: Sequence[str] = ("anna",),
    settings: Sequence[str] = (),
    localized_by: str | None = None,
    until: Callable[[Flights], bool] = lambda _: False,
) -> Flights:
    """Run `scenario` for people, or until something has happened; the same arguments give the same outcome.

    They are localized by the robot `localized_by`, `""` for the scenario's first. None: they are known.
    """
    plan = read_scenario(scenario) if isinstance(scenario, str) else scenario
    choices = Choices(seed=seed, settings=settings, localize=localized_by is not None, robot=localized_by)
    return with_fresh_state(_play(plan, choices, users, duration_s, until))


async def _play(
    plan: Scenario,
    choices: Choices,
    users: Sequence[str],
    duration_s: float,
    until: Callable[[Flights], bool],
) -> Flights:
    launches = site_launches(plan, choices)
    for index, user in enumerate(users):
        launches += user_launches(plan, choices, user, index)
    bus = MemoryBus(LocalBroker())
    flights = Flights()
    born: list[SimulatedPerson] = []
    people: dict[str, SimulatedPerson] = {}

    def on_state(state: RobotState, robot: str) -> None:
        people.update((person.user, person) for person in born)
        flights.on_state(robot, state, people)

    bus.subscribe(ROBOT_STATE, on_state)
    bus.subscribe(GOAL, lambda goal, user: flights.on_goal(goal, people[user]))
    bus.subscribe(FEEDBACK, lambda cue, user: flights.cues.append((user, cue)))
    monitor = Monitor(RunScore(()), VirtualClock(), watchers=[RobotWatcher(flights.robots)])
    monitor.attach(bus)
    with watched_people(born):
        async with running(launches, bus, VirtualClock()) as services:
            for _ in range(math.ceil(duration_s / STEP_S)):
                await asyncio.wait({services}, timeout=STEP_S)
                if services.done() or until(flights):
                    break
    return flights
