"""Change of the tolerance of hits while pui runs."""

import math
from typing import Any

import pytest

from pointit.geometry import vector
from pointit.runtime.errors import RefusedError
from pointit.schemas import SetTolerance, SetToleranceReply
from pointit.schemas.topics import SET_TOLERANCE
from tests.unit.pui.room import EYES, Room, room

STRIP_M = (4.85, 1.0, 0.9)


async def ask(here: Room, tolerance_deg: float | None = None) -> SetToleranceReply:
    tolerance_rad = None if tolerance_deg is None else math.radians(tolerance_deg)
    reply: SetToleranceReply = await here.bench.bus.call(
        SET_TOLERANCE, SetTolerance(tolerance_rad=tolerance_rad)
    )
    return reply


async def point(here: Room, beside_deg: float, user: str = "anna") -> str:
    """Point above a strip; return what the cursor is on."""
    reach = vector.subtract(STRIP_M, EYES)
    raised = vector.elevation(reach) + math.radians(beside_deg)
    await here.pose(user)
    here.clock.advance(0.02)
    return (await here.point(vector.direction(vector.azimuth(reach), raised), user)).surface


async def test_it_holds_for_everybody_from_the_next_ray_on() -> None:
    async with room() as here:
        reply = await ask(here)
        assert reply.tolerance_rad == pytest.approx(math.radians(12.0))
        assert "12.0°" in reply.message
        assert await point(here, 8.0) == "strip"
        reply = await ask(here, 5.0)
        assert reply.tolerance_rad == pytest.approx(math.radians(5.0))
        assert [await point(here, 8.0), await point(here, 8.0, "ben")] == ["none", "none"]
        assert await point(here, 3.0) == "strip"
        await ask(here, 20.0)
        assert [await point(here, 15.0), await point(here, 15.0, "ben")] == ["strip", "strip"]
        assert (await ask(here)).tolerance_rad == pytest.approx(math.radians(20.0))


@pytest.mark.parametrize(
    ("config", "why"),
    [
        ({"tolerance_m": 0.7}, "tolerance_m is 0.7; start pui without it"),
        ({"method": "kd_tree"}, "the method is kd_tree; start pui with method=exact"),
    ],
)
async def test_where_metres_tell_there_is_no_angle_to_set(config: dict[str, Any], why: str) -> None:
    async with room(**config) as here:
        reply = await ask(here)
        assert reply.tolerance_rad is None
        assert why in reply.message
        with pytest.raises(RefusedError, match=f"the tolerance is in metres here: {why}"):
            await ask(here, 5.0)
        assert await point(here, 4.0) == "strip"  # 0.36 m beside


async def test_the_widest_that_can_be_configured_can_be_told() -> None:
    async with room(tolerance_deg=89.99) as here:
        assert (await ask(here)).tolerance_rad == pytest.approx(math.radians(89.99), abs=0.01)
