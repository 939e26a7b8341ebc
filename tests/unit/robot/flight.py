"""A robot in its service, on a bus in memory and in virtual time, and a person who steers it."""

import asyncio
from collections.abc import Awaitable, Callable

from pointit.geometry.vector import Vec3
from pointit.runtime.bus.contract import Closable
from pointit.runtime.service.service import Launch, run_service
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
)
from pointit.schemas.topics import (
    CURSOR,
    GOAL,
    INTERACTION,
    MAP,
    OBJECTS,
    POSE,
    ROBOT_PLAN,
    ROBOT_STATE,
    STEERING,
    USER_ALIVE,
)
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.service import Robot
from tests.support.bench import Bench, memory_bench

ROBOT = "quad"
FLOOR = Plane(id="floor", center_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
ROOM = Environment(stamp_ns=1, name="hall", planes=(FLOOR,))
CURSOR_S = 0.02


def cursor_at(place_m: Vec3, stamp_ns: int) -> Cursor:
    """Return a cursor on the floor."""
    return Cursor(
        stamp_ns=stamp_ns, surface_id="floor", solid="plane", point_m=place_m, origin_m=(-3.0, 0.0, 1.6)
    )


class Pilotage:
    """Says what a person does, and notes what the robot says."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self._pointed: dict[str, Vec3 | None] = {}
        self._presences: dict[str, Closable] = {}
        self.states: list[RobotState] = bench.collect(ROBOT_STATE, ROBOT)
        self.plans: list[RobotPlan] = bench.collect(ROBOT_PLAN, ROBOT)
        self.objects: list[TrackedObjects] = bench.collect(OBJECTS, f"robot.{ROBOT}")
        bench.put(MAP, ROOM)

    @property
    def state(self) -> RobotState:
        return self.states[-1]

    def arrive(self, user: str) -> None:
        """Let `user` be present, localized and pointing."""
        self._presences[user] = self.bench.bus.announce(USER_ALIVE, user)
        now_ns = self.bench.clock.now_ns()
        self.bench.put(POSE, UserPose(stamp_ns=now_ns, position_m=(-3.0, 0.0, 0.0), yaw_rad=0.0), user)
        self.bench.put(INTERACTION, Interaction(stamp_ns=now_ns, state="pointing"), user)

    def leave(self, user: str) -> None:
        """End the presence of `user`."""
        self._presences.pop(user).close()

    def steer(self, user: str, steering: Steering) -> None:
        self.bench.put(STEERING, steering.model_copy(update={"stamp_ns": self.bench.clock.now_ns()}), user)

    def send(self, user: str, place_m: Vec3, *via_m: Vec3, stamp_ns: int | None = None) -> None:
        """Give a goal that is confirmed now."""
        now_ns = self.bench.clock.now_ns()
        self.bench.put(
            GOAL,
            Goal(
                stamp_ns=now_ns if stamp_ns is None else stamp_ns,
                position_m=place_m,
                via_m=via_m,
                yaw_rad=0.0,
                surface_id="floor",
                age_s=0.0,
                position_sigma_m=0.1,
                clearance_m=3.0,
                proposed_ns=now_ns,
                confirmed_by="press",
            ),
            user,
        )

    def point(self, user: str, place_m: Vec3 | None) -> None:
        """Let `user` point at a place on the floor from now on, or nowhere: no cursors come."""
        self._pointed[user] = place_m

    async def send_cursors(self) -> None:
        """Send the cursors of all who point, until cancelled."""
        while True:
            now_ns = self.bench.clock.now_ns()
            for user, place in self._pointed.items():
                if place is not None:
                    self.bench.put(CURSOR, cursor_at(place, now_ns), user)
            await asyncio.sleep(CURSOR_S)

    async def until(self, condition: Callable[[RobotState], bool], patience_s: float = 20.0) -> RobotState:
        """Wait until a state fulfils `condition`, and return it."""
        for _ in range(round(patience_s / CURSOR_S)):
            if self.states and condition(self.state):
                return self.state
            await asyncio.sleep(CURSOR_S)
        raise AssertionError(f"not within {patience_s} s: the last state is {self.states[-1:]}")


def fly(test: Callable[[Pilotage], Awaitable[None]], config: RobotConfig | None = None) -> None:
    """Run `test` with a robot, by default a simulated quadrotor."""

    async def run() -> None:
        async with memory_bench(VirtualClock()) as bench:
            chosen = config or RobotConfig(kind="quadrotor")
            launch = Launch(service=Robot, config=chosen, name=ROBOT)
            pilotage = Pilotage(bench)
            async with asyncio.TaskGroup() as group:
                tasks = [
                    group.create_task(run_service(launch, bench.bus, bench.clock)),
                    group.create_task(pilotage.send_cursors()),
                ]
                await test(pilotage)
                for task in tasks:
                    task.cancel()

    run_virtually(run())
