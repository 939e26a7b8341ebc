"""Shards of pui beside the default one: whose cursors each publishes, and on which map."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

from pointit.geometry.vector import Vec3
from pointit.schemas import Cloud, Environment, Health, Sphere
from pointit.schemas.topics import HEALTH, MAP, SHARD_ALIVE, USER_ALIVE
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from tests.support.bench import Bench, ManualClock, in_virtual_time, memory_bench, until
from tests.unit.pui.room import LAB, Room

PLACE: Vec3 = LAB.strips[0].line_m[0]


class Sharing(Room):
    """People of a room, some of whose cursors shards publish."""

    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        super().__init__(bench, clock)
        self.reports: list[Health] = bench.collect(HEALTH, "pui.anna")
        self.shards: set[str] = set()
        bench.bus.watch(SHARD_ALIVE, self._on_shard)
        for user in ("anna", "ben"):
            bench.bus.announce(USER_ALIVE, user)

    def _on_shard(self, name: str, *, present: bool) -> None:
        (self.shards.add if present else self.shards.discard)(name)

    async def start(self, **config: Any) -> None:
        self.shard = self.bench.start(Pui, PuiConfig(people=("anna",), **config), name="anna")
        await self.bench.settle()

    async def until_served(self, *, by_shard: bool = True) -> None:
        await until(lambda: ("pui.anna" in self.shards) == by_shard)
        await self.bench.settle()

    async def both_point(self) -> None:
        for user in ("anna", "ben"):
            await self.point_at(PLACE, user)


@asynccontextmanager
async def sharing() -> AsyncGenerator[Sharing]:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        yield Sharing(bench, clock)


def on_sphere(*, clouds: tuple[Cloud, ...] = ()) -> Environment:
    ball = Sphere(id="ball", center_m=PLACE, radius_m=0.2)
    return Environment(stamp_ns=1, name="hall", spheres=(ball,), clouds=clouds)


@in_virtual_time
async def test_people_of_an_ended_shard_keep_their_pose_and_workspace() -> None:
    async with sharing() as room:
        bench = room.bench
        bench.start(Pui)
        await room.start(workspace="horizontal")
        await room.until_served()
        await room.pose("anna")
        await room.both_point()
        await bench.end(room.shard)
        await room.until_served(by_shard=False)
        await room.both_point()
        assert [cursor.surface_id for cursor in room.of["anna"]] == ["workspace/horizontal", LAB.strips[0].id]


@in_virtual_time
async def test_a_shard_waits_for_the_map_and_follows_it() -> None:
    async with sharing() as room:
        bench = room.bench
        await room.pose("anna")
        await room.start(surfaces=("strip", "sphere"))
        bench.put(MAP, LAB)
        await room.until_served()
        assert (await room.point_at(PLACE)).surface == "strip"
        bench.put(MAP, on_sphere())
        await bench.settle()
        assert (await room.point_at(PLACE)).surface_id == "ball"  # the pose is known still


@in_virtual_time
async def test_map_with_point_clouds_leaves_people_to_the_site() -> None:
    cloud = Cloud(id="shelf", points=3, low_m=(0.0, 0.0, 0.0), high_m=(1.0, 1.0, 1.0))
    async with sharing() as room:
        bench = room.bench
        await room.start(surfaces=("sphere", "points"))
        bench.put(MAP, on_sphere())
        await room.until_served()
        bench.put(MAP, on_sphere(clouds=(cloud,)))
        await room.until_served(by_shard=False)
        await until(lambda: any("point clouds" in text for text in room.reports[-1].warnings))
        bench.put(MAP, on_sphere())
        await room.until_served()
        await until(lambda: room.reports[-1].warnings == ())


@in_virtual_time
async def test_a_map_without_anything_to_point_at_is_told() -> None:
    async with sharing() as room:
        bench = room.bench
        await room.start(surfaces=("belt",))
        bench.put(MAP, LAB)
        await until(
            lambda: bool(room.reports) and any("has no belt" in text for text in room.reports[-1].warnings)
        )
        assert room.shards == set()
