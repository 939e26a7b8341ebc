"""A robot in its service, on a bus in memory and in virtual time, and a person who steers it."""

import asyncio
import functools
import inspect
from collections.abc import Awaitable, Callable, Iterable
from typing import Any, Concatenate, ParamSpec

from pointit.geometry.vector import Vec3
from pointit.runtime.bus.contract import Closable
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import (
    Cursor,
    Environment,
    Goal,
    Interaction,
    Plane,
    RobotPlan,
    RobotState,
    Steering,
    TrackedObjects,
    UserPose,
    topics,
)
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.drivers.sim_driver import SimDriver
from pointit.services.robot.robot_driver import Command, Report, ReportItem, RobotReport
from pointit.services.robot.service import Robot
from tests.support.bench import Bench, memory_bench

P = ParamSpec("P")
ROBOT = "quad"
FLOOR = Plane(id="floor", center_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
ROOM = Environment(stamp_ns=1, name="hall", planes=(FLOOR,))
CURSOR_S = 0.02


def cursor_at(place_m: Vec3, stamp_ns: int) -> Cursor:
    return Cursor(
        stamp_ns=stamp_ns, surface_id="floor", solid="plane", point_m=place_m, origin_m=(-3.0, 0.0, 1.6)
    )


def goal_at(place_m: Vec3, *via_m: Vec3, stamp_ns: int, robot: str = "") -> Goal:
    """Return a goal on the floor that is confirmed by a press."""
    return Goal(
        stamp_ns=stamp_ns, position_m=place_m, via_m=via_m, yaw_rad=0.0, surface_id="floor", age_s=0.0,
        position_sigma_m=0.1, clearance_m=3.0, proposed_ns=stamp_ns, confirmed_by="press", robot=robot,
    )  # fmt: skip


class Pilotage:
    """Says what a person does, and notes what the robot says."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self._pointed: dict[str, Vec3 | None] = {}
        self._presences: dict[str, Closable] = {}
        self.states: list[RobotState] = bench.collect(topics.ROBOT_STATE, ROBOT)
        self.plans: list[RobotPlan] = bench.collect(topics.ROBOT_PLAN, ROBOT)
        self.objects: list[TrackedObjects] = bench.collect(topics.OBJECTS, f"robot.{ROBOT}")
        bench.put(topics.MAP, ROOM)

    @property
    def state(self) -> RobotState:
        return self.states[-1]

    def arrive(self, user: str, place_m: Vec3 | None = None) -> None:
        """Let `user` be present, localized and pointing, at `place_m` on the floor."""
        self.point(user, place_m)
        self._presences[user] = self.bench.bus.announce(topics.USER_ALIVE, user)
        self.pose(user, (-3.0, 0.0, 0.0))
        pointing = Interaction(stamp_ns=self.bench.clock.now_ns(), state="pointing")
        self.bench.put(topics.INTERACTION, pointing, user)

    def pose(self, user: str, place_m: Vec3, **changes: object) -> None:
        pose = UserPose(stamp_ns=self.bench.clock.now_ns(), position_m=place_m, yaw_rad=0.0)
        self.bench.put(topics.POSE, pose.model_copy(update=changes), user)

    async def take_for_goals(self, user: str) -> None:
        """Let `user` name the robot, which they get, for goals."""
        self.steer(user, Steering(stamp_ns=0, robot=ROBOT, mode="goals"))
        await self.until(lambda state: state.user == user)

    def leave(self, user: str) -> None:
        self._presences.pop(user).close()

    def steer(self, user: str, steering: Steering) -> None:
        self.bench.put(
            topics.STEERING, steering.model_copy(update={"stamp_ns": self.bench.clock.now_ns()}), user
        )

    def send(self, user: str, place_m: Vec3, *via_m: Vec3, stamp_ns: int | None = None) -> None:
        """Give a goal that is confirmed now."""
        now_ns = self.bench.clock.now_ns()
        self.bench.put(topics.GOAL, goal_at(place_m, *via_m, stamp_ns=stamp_ns or now_ns), user)

    def point(self, user: str, place_m: Vec3 | None) -> None:
        """Let `user` point at a place on the floor from now on, or nowhere: no cursors come."""
        self._pointed[user] = place_m

    async def send_cursors(self) -> None:
        while True:
            now_ns = self.bench.clock.now_ns()
            for user, place in self._pointed.items():
                if place is not None:
                    self.bench.put(topics.CURSOR, cursor_at(place, now_ns), user)
            await asyncio.sleep(CURSOR_S)

    async def until(self, condition: Callable[[RobotState], bool], patience_s: float = 20.0) -> RobotState:
        for _ in range(round(patience_s / CURSOR_S)):
            if self.states and condition(self.state):
                return self.state
            await asyncio.sleep(CURSOR_S)
        raise AssertionError(f"not within {patience_s} s: the last state is {self.states[-1:]}")


class FaultyDriver(SimDriver):
    """A simulated robot. `change` replaces what it says, `is_deaf` loses what it is told."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.commands: list[Command] = []
        """All that it was told."""
        self.truth: RobotReport | None = None
        self.change: Callable[[ReportItem], Iterable[ReportItem]] = lambda item: (item,)
        self.is_deaf = False
        self.say: Report = lambda _item: None

    async def run(self, report: Report) -> None:
        """Report what `change` makes of the truth."""
        self.say = report

        def changed(item: ReportItem) -> None:
            if isinstance(item, RobotReport):
                self.truth = item
            for each in self.change(item):
                report(each)

        await super().run(changed)

    def command(self, command: Command) -> None:
        self.commands.append(command)
        if not self.is_deaf:
            super().command(command)


def flown(
    config: RobotConfig | None = None,
) -> Callable[[Callable[Concatenate[Pilotage, P], Awaitable[None]]], Callable[P, None]]:
    """Run a test with a robot, by default a simulated quadrotor, in virtual time."""
    chosen = config or RobotConfig(kind="quadrotor")

    def decorated(test: Callable[Concatenate[Pilotage, P], Awaitable[None]]) -> Callable[P, None]:
        async def fly(*args: P.args, **kwargs: P.kwargs) -> None:
            async with memory_bench(VirtualClock()) as bench:
                pilotage = Pilotage(bench)
                bench.start(Robot, chosen, name=ROBOT)
                cursors = asyncio.create_task(pilotage.send_cursors())
                await test(pilotage, *args, **kwargs)
                cursors.cancel()

        @functools.wraps(test)
        def run(*args: P.args, **kwargs: P.kwargs) -> None:
            run_virtually(fly(*args, **kwargs))

        signature = inspect.signature(test)
        fixtures = [*signature.parameters.values()][1:]
        run.__signature__ = signature.replace(parameters=fixtures)  # pyrefly: ignore[missing-attribute]
        return run

    return decorated
