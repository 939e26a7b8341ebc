"""How far a ray may pass what it points at, set while pui runs."""

import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from pointit.geometry import vector
from pointit.runtime import RefusedError
from pointit.schemas import Cursor, PointingRay, SetTolerance, SetToleranceReply, UserPose
from pointit.schemas.topics import CURSOR, POSE, RAY, SET_TOLERANCE
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from tests.support.bench import Bench, ManualClock, memory_bench

EYES = (0.0, 0.0, 1.64)
STRIP_M = (4.85, 1.0, 0.9)


class Room:
    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        self.bench, self.clock = bench, clock
        self.cursors: list[Cursor] = bench.collect(CURSOR)

    async def ask(self, tolerance_deg: float | None = None) -> SetToleranceReply:
        tolerance_rad = None if tolerance_deg is None else math.radians(tolerance_deg)
        reply: SetToleranceReply = await self.bench.bus.call(
            SET_TOLERANCE, SetTolerance(tolerance_rad=tolerance_rad)
        )
        return reply

    async def point(self, beside_deg: float, user: str = "anna") -> str:
        """Point above a strip; return what the cursor is on."""
        reach = vector.subtract(STRIP_M, EYES)
        raised = vector.elevation(reach) + math.radians(beside_deg)
        direction = vector.direction(vector.azimuth(reach), raised)
        self.bench.put(POSE, UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0), user)
        await self.bench.settle()
        stamp_ns = self.clock.advance(0.02)
        self.bench.put(RAY, PointingRay(stamp_ns=stamp_ns, origin_m=EYES, direction=direction), user)
        await self.bench.settle()
        return self.cursors[-1].surface


@asynccontextmanager
async def room(**config: Any) -> AsyncGenerator[Room]:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        here = Room(bench, clock)
        bench.start(Pui, PuiConfig(map="lab", **config))
        await bench.settle()
        yield here


async def test_it_holds_for_everybody_from_the_next_ray_on() -> None:
    async with room() as here:
        reply = await here.ask()
        assert reply.tolerance_rad == pytest.approx(math.radians(12.0))
        assert "12.0°" in reply.message
        assert await here.point(8.0) == "strip"
        reply = await here.ask(5.0)
        assert reply.tolerance_rad == pytest.approx(math.radians(5.0))
        assert [await here.point(8.0), await here.point(8.0, "ben")] == ["none", "none"]
        assert await here.point(3.0) == "strip"
        await here.ask(20.0)
        assert [await here.point(15.0), await here.point(15.0, "ben")] == ["strip", "strip"]
        assert (await here.ask()).tolerance_rad == pytest.approx(math.radians(20.0))


@pytest.mark.parametrize(
    ("config", "why"),
    [
        ({"tolerance_m": 0.7}, "tolerance_m is 0.7; start pui without it"),
        ({"method": "kd_tree"}, "the method is kd_tree; start pui with method=exact"),
    ],
)
async def test_where_metres_tell_there_is_no_angle_to_set(config: dict[str, Any], why: str) -> None:
    async with room(**config) as here:
        reply = await here.ask()
        assert reply.tolerance_rad is None
        assert why in reply.message
        with pytest.raises(RefusedError, match=f"metres tell what is near enough here: {why}"):
            await here.ask(5.0)
        assert await here.point(4.0) == "strip"  # 0.36 m beside


async def test_the_widest_that_can_be_configured_can_be_told() -> None:
    async with room(tolerance_deg=89.99) as here:
        assert (await here.ask()).tolerance_rad == pytest.approx(math.radians(89.99), abs=0.01)
