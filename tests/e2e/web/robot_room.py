"""A room with two people and two robots on a memory bus, told as the services would tell it."""

import asyncio
import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import TypeVar

import pointit.schemas as models
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.clock import WallClock
from pointit.schemas import topics
from pointit.schemas.environment import Fence
from pointit.schemas.pointing import Candidate
from pointit.schemas.requests import Done
from tests.support.bench import Bench, memory_bench

M = TypeVar("M", bound=models.Message)

EVERY_S = 0.1

ROOM = models.Environment(
    stamp_ns=1,
    name="robots",
    lamps=(
        models.Lamp(id="led_0", position_m=(0.0, 3.0, 1.0)),
        models.Lamp(id="led_1", position_m=(4.0, 3.0, 1.0)),
    ),
    planes=(models.Plane(id="floor", center_m=(2.0, 0.5, 0.0), normal=(0.0, 0.0, 1.0), size_m=(6.0, 5.0)),),
    boxes=(models.Box(id="desk", center_m=(4.4, 0.4, 0.375), size_m=(0.6, 1.2, 0.75)),),
    fences=(
        Fence(id="room", kind="keep_in", outline_m=((-1.0, -2.0), (5.0, -2.0), (5.0, 3.0), (-1.0, 3.0))),
        Fence(
            id="desk",
            kind="keep_out",
            outline_m=((3.9, -0.4), (4.9, -0.4), (4.9, 1.2), (3.9, 1.2)),
            high_m=1.5,
        ),
    ),
)
COLORS = {"anna": (86, 180, 233), "ben": (230, 159, 0)}
PLACES: dict[str, Vec3] = {"anna": (0.0, -1.5, 0.0), "ben": (3.2, -1.6, 0.0)}
AIMS: dict[str, Vec3] = {"anna": (1.2, 1.2, 0.0), "ben": (2.9, 1.9, 0.0)}

QUAD = models.RobotState(
    stamp_ns=1, kind="quadrotor", phase="moving", position_m=(0.5, 0.3, 0.8), yaw_rad=0.9,
    velocity_mps=(0.0, 0.0, 0.0), radius_m=0.15, user="anna", target_m=(1.2, 1.2, 0.2), battery=0.62,
)  # fmt: skip
CART = models.RobotState(
    stamp_ns=1, kind="ground", phase="idle", position_m=(2.4, 0.4, 0.0), yaw_rad=2.4,
    velocity_mps=(0.0, 0.0, 0.0), radius_m=0.2,
)  # fmt: skip


@dataclass
class RobotRoom:
    """The room; `states` are published at a steady rate and may be replaced."""

    bench: Bench
    states: dict[str, models.RobotState] = field(default_factory=lambda: {"quad": QUAD, "cart": CART})
    stopped: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    """Robots that were asked to stop, and why."""

    def put(self, topic: topics.Topic[M], message: M, name: str = "") -> None:
        self.bench.put(topic, message.model_copy(update={"stamp_ns": self.bench.clock.now_ns()}), name)

    def begin(self) -> None:
        bus = self.bench.bus
        for user in COLORS:
            bus.announce(topics.USER_ALIVE, user)
        for instance in (f"robot.{name}" for name in self.states):
            bus.announce(topics.SERVICE_ALIVE, instance)
        bus.serve(topics.STOP_ROBOT, self._stop)
        self.put(topics.MAP, ROOM)
        for user, color in COLORS.items():
            profile = models.UserProfile(
                stamp_ns=1, cursor_color=color, pattern="solid" if user == "anna" else "dashed"
            )
            self.put(topics.PROFILE, profile, user)
            self.put(
                topics.POSE, models.UserPose(stamp_ns=1, position_m=PLACES[user], yaw_rad=math.pi / 2), user
            )
            self.put(topics.INTERACTION, models.Interaction(stamp_ns=1, state="pointing"), user)
        self.put(topics.STEERING, models.Steering(stamp_ns=1, robot="quad", mode="follow"), "anna")
        waypoints = ((2.0, 1.2, 0.0), (2.9, 1.9, 0.0))
        meant = (Candidate(object_id="cart", probability=0.93), Candidate(object_id="quad", probability=0.07))
        self.put(topics.STEERING, models.Steering(stamp_ns=1, waypoints_m=waypoints, candidates=meant), "ben")
        way = ((0.8, 0.6, 0.6), (1.2, 1.2, 0.2))
        self.put(topics.ROBOT_PLAN, models.RobotPlan(stamp_ns=1, line_m=way, user="anna"), "quad")

    async def _stop(self, query: models.StopRobot, name: str) -> Done:
        self.stopped.append((name, query.reason))
        update = {
            "phase": "stopped",
            "user": "",
            "target_m": None,
            "reason": f"{query.reason}: point at it to take it",
        }
        self.states[name] = self.states[name].model_copy(update=update)
        self.put(topics.ROBOT_PLAN, models.RobotPlan(stamp_ns=1), name)
        self.tell()
        return Done()

    def tell(self) -> None:
        for user, aim in AIMS.items():
            x, y, z = PLACES[user]
            eyes = (x, y, z + 1.6)
            way = vector.subtract(aim, eyes)
            ray = vector.scale(way, 1.0 / vector.norm(way))
            cursor = models.Cursor(
                stamp_ns=1, solid="plane", surface_id="floor", point_m=aim, origin_m=eyes, direction=ray
            )
            self.put(topics.CURSOR, cursor, user)
        for name, state in self.states.items():
            self.put(topics.ROBOT_STATE, state, name)
            seen = models.TrackedObject(id=name, kind="robot", position_m=state.position_m)
            self.put(topics.OBJECTS, models.TrackedObjects(stamp_ns=1, objects=(seen,)), f"robot.{name}")

    async def go_on(self) -> None:
        """Tell the state at a steady rate."""
        while True:
            self.tell()
            await asyncio.sleep(EVERY_S)


@asynccontextmanager
async def robot_room() -> AsyncGenerator[RobotRoom]:
    """Yield the room, which goes on until the end."""
    async with memory_bench(WallClock()) as bench:
        room = RobotRoom(bench)
        room.begin()
        going = asyncio.create_task(room.go_on())
        try:
            yield room
        finally:
            going.cancel()
            await asyncio.gather(going, return_exceptions=True)
