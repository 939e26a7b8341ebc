"""Plays a shipped scenario with its real services on a bus in memory, in virtual time."""

import asyncio
import contextlib
import math
import os
import tempfile
from collections.abc import AsyncGenerator, Coroutine, Generator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar
from unittest import mock

import pointit.schemas as models
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import Scenario, read_scenario
from pointit.launch.run.monitor import Monitor, RunScore
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.service.service import Launch, run_services
from pointit.runtime.virtual_time import START_NS, VirtualClock, run_virtually
from pointit.schemas import topics
from pointit.services.user_sim import service as user_sim
from pointit.services.user_sim.person import SimulatedPerson
from tests.unit.cli_run.drawn import FRAME, shown

T = TypeVar("T")
Running = asyncio.Task[None]
USER = "anna"
WIDTHS = (60, 80, 120)


@dataclass(frozen=True)
class Found:
    """A pose as it was said, and what was true then."""

    at_s: float
    pose: models.UserPose
    truth_m: tuple[float, float, float]
    true_yaw_rad: float

    @property
    def position_error_m(self) -> float:
        return math.dist(self.pose.position_m[:2], self.truth_m[:2])

    @property
    def yaw_error_deg(self) -> float:
        return abs(math.degrees(math.remainder(self.pose.yaw_rad - self.true_yaw_rad, math.tau)))


@dataclass
class Outcome:
    """Messages and views of a run, as seen from outside."""

    kinds: dict[str, str] = field(default_factory=dict[str, str])
    fed_s: dict[str, float] = field(default_factory=dict[str, float])
    events: list[models.SelectionEvent] = field(default_factory=list[models.SelectionEvent])
    cursors: list[models.Cursor] = field(default_factory=list[models.Cursor])
    states: list[str] = field(default_factory=list[str])
    steps: list[models.Interaction] = field(default_factory=list[models.Interaction])
    found: list[Found] = field(default_factory=list[Found])
    """Poses, each as it was said; and in `followed` as it stood at each sample of the wrist."""
    followed: list[Found] = field(default_factory=list[Found])
    progress: list[models.Localization] = field(default_factory=list[models.Localization])
    anchors: list[models.Anchor] = field(default_factory=list[models.Anchor])
    cues: list[models.Feedback] = field(default_factory=list[models.Feedback])
    goals: list[tuple[models.Goal, float]] = field(default_factory=list[tuple[models.Goal, float]])
    """Goals of the robot, each with its distance from the intended place on the floor, m."""
    monitor: Monitor | None = None
    """Monitor from which the view of a run is drawn."""
    view: dict[int, str] = field(default_factory=dict[int, str])
    """The words in it at the end, by the width of the terminal."""
    nearly: float = 0.0
    """Highest progress at an object that is not a target or is already selected, 0 to 1."""

    def on_hover(self, hover: models.Hover, target_kinds: Sequence[str]) -> None:
        """Note how near the person comes to a mistake."""
        chosen = self.chosen()
        if hover.object_id in chosen or self.kinds.get(hover.object_id) not in (None, *target_kinds):
            self.nearly = max(self.nearly, hover.progress)

    def of(self, event: str, kind: str, *, is_kind: bool = True) -> list[str]:
        """Return the objects of `kind` (or of any other) to which `event` happened."""
        return [e.object_id for e in self.events if e.event == event and (e.kind == kind) == is_kind]

    def chosen(self) -> set[str]:
        """Return the objects that are selected, or were selected when they left."""
        chosen: set[str] = set()
        for event in self.events:
            if event.event == "selected":
                chosen.add(event.object_id)
            elif event.event == "deselected":
                chosen.discard(event.object_id)
        return chosen

    def final(self, kind: str) -> tuple[int, int, int]:
        """Return the numbers of selected and missed objects of `kind`, and of selections of other kinds."""
        chosen = self.chosen()
        targets = {name for name, its in self.kinds.items() if its == kind}
        return len(targets & chosen), len(targets - chosen), len(self.of("selected", kind, is_kind=False))


@contextlib.contextmanager
def watched_people(people: list[SimulatedPerson]) -> Generator[None]:
    """Add to `people` the simulated ones who are born meanwhile: they know where they truly stand."""

    class Watched(SimulatedPerson):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            people.append(self)

    with mock.patch.object(user_sim, "SimulatedPerson", Watched):
        yield


@contextlib.asynccontextmanager
async def running(launches: Sequence[Launch], bus: MemoryBus, clock: VirtualClock) -> AsyncGenerator[Running]:
    """Run services until the block ends; raise what has ended them before."""
    services = asyncio.create_task(run_services(launches, bus, clock))
    yield services
    if services.done():
        services.result()
    services.cancel()
    await asyncio.gather(services, return_exceptions=True)
    await bus.close()


def with_fresh_state(run: Coroutine[Any, Any, T]) -> T:
    """Return the result of `run`, in virtual time and on nothing kept before."""
    with tempfile.TemporaryDirectory() as state, mock.patch.dict(os.environ, {"POINTIT_STATE": state}):
        return run_virtually(run)


def play(
    scenario: str | Scenario,
    choices: Choices,
    duration_s: float | None = None,
    *,
    users: Sequence[str] = (USER,),
) -> Outcome:
    """Run `scenario` for one person or nobody, on nothing kept before; the same choices: the same outcome."""
    plan = read_scenario(scenario) if isinstance(scenario, str) else scenario
    return with_fresh_state(_play(plan, choices, duration_s or plan.duration_s or 60.0, users))


def _words(monitor: Monitor, width: int) -> str:
    """Return the text of the view without its frame and line breaks."""
    return " ".join(" ".join(line[FRAME:-FRAME] for line in shown(monitor, width)).split())


async def _play(plan: Scenario, choices: Choices, duration_s: float, users: Sequence[str]) -> Outcome:
    launches = site_launches(plan, choices)
    for user in users:
        launches += user_launches(plan, choices, user)
    bus = MemoryBus(LocalBroker())
    clock = VirtualClock()
    outcome = Outcome()
    people: list[SimulatedPerson] = []

    def on_objects(message: models.TrackedObjects, _name: str) -> None:
        for thing in message.objects:
            outcome.kinds.setdefault(thing.id, thing.kind)
            outcome.fed_s.setdefault(thing.id, (message.stamp_ns - START_NS) / 1e9)

    def on_interaction(now: models.Interaction, _name: str) -> None:
        outcome.states.append(now.state)
        outcome.steps.append(now)

    def stands(pose: models.UserPose) -> Found:
        person = people[-1]
        at_s = (clock.now_ns() - START_NS) / models.NS_PER_S
        return Found(at_s, pose, person.position_m, person.true_yaw_rad)

    def on_pose(pose: models.UserPose, _name: str) -> None:
        outcome.found.append(stands(pose))

    def on_imu(_sample: models.ImuSample, _name: str) -> None:
        if outcome.found:
            outcome.followed.append(stands(outcome.found[-1].pose))

    def on_goal(goal: models.Goal, _name: str) -> None:
        meant_m = people[-1].goal.point_m
        outcome.goals.append(
            (goal, math.inf if meant_m is None else math.dist(goal.position_m[:2], meant_m[:2]))
        )

    bus.subscribe(topics.OBJECTS, on_objects)
    bus.subscribe(topics.SELECTION_EVENTS, lambda event, _name: outcome.events.append(event))
    bus.subscribe(topics.HOVER, lambda hover, _name: outcome.on_hover(hover, plan.target_kinds), USER)
    bus.subscribe(topics.CURSOR, lambda cursor, _name: outcome.cursors.append(cursor), USER)
    bus.subscribe(topics.INTERACTION, on_interaction, USER)
    bus.subscribe(topics.LOCALIZATION, lambda news, _name: outcome.progress.append(news), USER)
    bus.subscribe(topics.ANCHOR, lambda anchor, _name: outcome.anchors.append(anchor), USER)
    bus.subscribe(topics.FEEDBACK, lambda cue, _name: outcome.cues.append(cue), USER)
    bus.subscribe(topics.GOAL, on_goal, USER)
    bus.subscribe(topics.POSE, on_pose, USER)
    bus.subscribe(topics.IMU, on_imu, USER)
    outcome.monitor = Monitor(RunScore(plan.target_kinds), clock)
    outcome.monitor.attach(bus)
    with watched_people(people):
        async with running(launches, bus, clock) as services:
            await asyncio.wait({services}, timeout=duration_s)
            outcome.view = {width: _words(outcome.monitor, width) for width in WIDTHS}
    return outcome
