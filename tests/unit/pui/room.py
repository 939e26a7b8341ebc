"""A running pui on the lab's map, and people who stand somewhere and point from there."""

from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from typing import Any

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.maps.file import load_map
from pointit.schemas import Cursor, Interaction, PointingRay, UserPose
from pointit.schemas.topics import CURSOR, HEALTH, INTERACTION, POSE, RAY
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from tests.support.bench import Bench, ManualClock, memory_bench, until

LAB = load_map("lab", 0)
EYES: Vec3 = (0.0, 0.0, 1.64)
ORIGIN: Vec3 = (0.0, 0.0, 0.0)
S = 1_000_000_000


def pose_at(
    position_m: Vec3 = (1.0, 0.5, 0.0), yaw_rad: float = 0.7, bias_rad: float = 0.0, stamp_ns: int = 0
) -> UserPose:
    return UserPose(stamp_ns=stamp_ns, position_m=position_m, yaw_rad=yaw_rad, elevation_bias_rad=bias_rad)


def ray_to(target: Vec3, pose: UserPose, stamp_ns: int = 0, bias_rad: float = 0.0) -> PointingRay:
    """Return the ray in {H} of a person at `pose` who points `bias_rad` above `target` in {W}."""
    reach = vector.rotate_z(vector.subtract(target, vector.add(pose.position_m, EYES)), -pose.yaw_rad)
    direction = vector.direction(vector.azimuth(reach), vector.elevation(reach) + bias_rad)
    return PointingRay(stamp_ns=stamp_ns, origin_m=EYES, direction=direction)


class Room:
    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        self.bench = bench
        self.clock = clock
        self.cursors: list[Cursor] = bench.collect(CURSOR)
        """Everybody's."""
        self.of: dict[str, list[Cursor]] = {}
        """By person."""
        self._poses: dict[str, UserPose] = {}
        bench.bus.subscribe(CURSOR, lambda cursor, user: self.of.setdefault(user, []).append(cursor))

    async def pose(self, user: str = "anna", pose: UserPose | None = None) -> None:
        self._poses[user] = pose or pose_at(ORIGIN, 0.0, stamp_ns=self.clock.now_ns())
        self.bench.put(POSE, self._poses[user], user)
        await self.bench.settle()

    async def interact(self, state: str, user: str = "anna") -> None:
        said = Interaction.model_validate({"stamp_ns": self.clock.now_ns(), "state": state})
        self.bench.put(INTERACTION, said, user)
        await self.bench.settle()

    async def send(self, ray: PointingRay, user: str = "anna") -> Cursor | None:
        self.bench.put(RAY, ray, user)
        await self.bench.settle()
        return self.cursors[-1] if self.cursors else None

    async def point(self, direction: Vec3, user: str = "anna") -> Cursor:
        stamp_ns = self.clock.advance(0.02)
        await self.send(PointingRay(stamp_ns=stamp_ns, origin_m=EYES, direction=direction), user)
        return self.cursors[-1]

    async def point_at(self, place: Vec3, user: str = "anna") -> Cursor:
        await self.aim(place, user)
        return self.cursors[-1]

    async def aim(self, place: Vec3, user: str = "anna") -> int:
        """Point at it 20 ms later, whether a cursor comes of it or not; return the ray's stamp."""
        stamp_ns = self.clock.advance(0.02)
        await self.send(ray_to(place, self._poses.get(user) or pose_at(), stamp_ns), user)
        return stamp_ns

    async def until_health(self, condition: Callable[[tuple[str, ...]], bool]) -> None:
        reports = self.bench.collect(HEALTH, "pui")
        await until(lambda: bool(reports) and condition(reports[-1].warnings), what="health")


@asynccontextmanager
async def room(**config: Any) -> AsyncGenerator[Room]:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        here = Room(bench, clock)
        bench.start(Pui, PuiConfig(**config))
        await bench.settle()
        yield here
