"""Effect of poses on pui: the person's elevation bias, and two sources at once."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.file import load_map
from pointit.schemas import PointingRay, UserPose
from pointit.schemas.topics import CURSOR, POSE, RAY
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.service import Pui
from pointit.services.pui.surfaces import Surfaces
from tests.support.bench import ManualClock, memory_bench, until
from tests.support.known import known

LAB = load_map("lab", 0)
EYES: Vec3 = (0.0, 0.0, 1.64)
S = 1_000_000_000


def pose(bias_rad: float = 0.0, stamp_ns: int = 0, x_m: float = 1.0) -> UserPose:
    return UserPose(stamp_ns=stamp_ns, position_m=(x_m, 0.5, 0.0), yaw_rad=0.7, elevation_bias_rad=bias_rad)


def ray_to(target: Vec3, at: UserPose, bias_rad: float, stamp_ns: int = 0) -> PointingRay:
    """Return the ray in {H} of a person who points `bias_rad` above `target`."""
    reach = vector.subtract(target, vector.add(at.position_m, EYES))
    direction = vector.direction(vector.azimuth(reach) - at.yaw_rad, vector.elevation(reach) + bias_rad)
    return PointingRay(stamp_ns=stamp_ns, origin_m=EYES, direction=direction)


@given(st.integers(0, 1), st.floats(0.05, 4.95), st.floats(math.radians(-15), math.radians(15)))
def test_at_the_estimated_pose_the_rays_hit_what_is_pointed_at(
    number: int, position_m: float, bias_rad: float
) -> None:
    target = Polyline(LAB.strips[number].line_m).point_at(position_m)
    person = PersonCursor(Surfaces(LAB, ["strip"]))
    person.set_pose(pose(bias_rad))
    cursor = known(person.cursor(ray_to(target, pose(), bias_rad)))
    assert cursor.miss_rad < 1e-6


@pytest.mark.parametrize("bias_rad", [1e6, -1e6, math.pi, -3.0])
@pytest.mark.parametrize("elevation_rad", [-math.pi / 2, -1.0, 0.0, 1.5, math.pi / 2])
def test_no_bias_turns_a_ray_over(bias_rad: float, elevation_rad: float) -> None:
    cast: list[Vec3] = []

    class Spy(Surfaces):
        def hit_test(self, origin_m: Vec3, direction: Vec3) -> None:
            assert origin_m[2] == EYES[2]
            cast.append(direction)

    person = PersonCursor(Spy(LAB))
    person.set_pose(pose(bias_rad).model_copy(update={"yaw_rad": 0.0}))
    person.cursor(PointingRay(stamp_ns=0, origin_m=EYES, direction=vector.direction(0.4, elevation_rad)))
    (direction,) = cast
    assert vector.norm(direction) == pytest.approx(1.0)
    assert direction[0] >= -1e-9  # still ahead
    moved = abs(vector.elevation(direction) - elevation_rad)
    assert moved <= math.radians(45.0) + 1e-9


def test_of_two_who_tell_the_pose_the_newer_counts_while_both_do() -> None:
    surfaces = Surfaces(LAB)
    person = PersonCursor(surfaces)

    def x_m() -> float:
        seen = known(person.cursor(ray_to(Polyline(LAB.strips[1].line_m).point_at(2.5), pose(), 0.0)))
        assert seen.point_m is not None
        return round(seen.point_m[0], 6)

    person.set_pose(pose(x_m=1.0, stamp_ns=5 * S), now_ns=10 * S)
    tracker = x_m()
    person.set_pose(pose(x_m=2.0, stamp_ns=4 * S), now_ns=11 * S)
    assert x_m() == tracker
    person.set_pose(pose(x_m=2.0, stamp_ns=6 * S), now_ns=11 * S)
    assert x_m() != tracker
    person.set_pose(pose(x_m=1.0, stamp_ns=3 * S), now_ns=14 * S)  # the other is silent: its clock was ahead
    assert x_m() == tracker


async def test_the_service_takes_the_bias_out_and_the_newer_pose() -> None:
    clock = ManualClock()
    bias_rad = math.radians(6.0)
    target = Polyline(LAB.strips[1].line_m).point_at(2.5)
    async with memory_bench(clock) as bench:
        cursors = bench.collect(CURSOR, "anna")
        bench.start(Pui, PuiConfig(map="lab"))
        await bench.settle()
        bench.put(POSE, pose(bias_rad, stamp_ns=clock.now_ns()), "anna")
        await bench.settle()
        bench.put(POSE, pose(0.0, stamp_ns=clock.now_ns() - S, x_m=9.0), "anna")
        await bench.settle()
        bench.put(RAY, ray_to(target, pose(), bias_rad, clock.now_ns()), "anna")
        await until(lambda: bool(cursors), what="a cursor")
        assert cursors[-1].miss_rad < 1e-6
