"""A running pui on the lab's map, and people who stand at the origin and point from there."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import Cursor, PointingRay, UserPose
from pointit.schemas.topics import CURSOR, POSE, RAY
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from tests.support.bench import Bench, ManualClock, memory_bench

EYES: Vec3 = (0.0, 0.0, 1.64)


class Room:
    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        self.bench, self.clock = bench, clock
        self.cursors: list[Cursor] = bench.collect(CURSOR)
        """Everybody's."""

    async def pose(self, user: str = "anna") -> None:
        pose = UserPose(stamp_ns=self.clock.now_ns(), position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)
        self.bench.put(POSE, pose, user)
        await self.bench.settle()

    async def point(self, direction: Vec3, user: str = "anna") -> Cursor:
        ray = PointingRay(stamp_ns=self.clock.now_ns(), origin_m=EYES, direction=direction)
        self.bench.put(RAY, ray, user)
        await self.bench.settle()
        return self.cursors[-1]

    async def point_at(self, place: Vec3, user: str = "anna") -> Cursor:
        return await self.point(vector.normalized(vector.subtract(place, EYES)), user)


@asynccontextmanager
async def room(**config: Any) -> AsyncGenerator[Room]:
    """Yield a room with pui configured so."""
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        here = Room(bench, clock)
        values: dict[str, Any] = {"map": "lab"} | config
        bench.start(Pui, PuiConfig(**values))
        await bench.settle()
        yield here
