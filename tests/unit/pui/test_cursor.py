"""A person's cursor: where it is, when there is none; the elevation bias, and two sources of poses."""

import math
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import Interaction, PointingRay, UserPose
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.surfaces import Surfaces
from tests.support.known import known
from tests.unit.pui.room import EYES, LAB, S, pose_at, ray_to


def on_strip(number: int, position_m: float) -> Vec3:
    return Polyline(LAB.strips[number].line_m).point_at(position_m)


@given(
    number=st.integers(0, 1),
    position_m=st.floats(0.05, 4.95),
    stand=st.tuples(st.floats(-2, 4), st.floats(-3, 3), st.floats(-0.2, 0.5)),
    yaw_rad=st.floats(-math.pi, math.pi),
)
def test_pointing_at_a_place_on_a_strip_puts_the_cursor_there(
    number: int, position_m: float, stand: Vec3, yaw_rad: float
) -> None:
    pose = pose_at(stand, yaw_rad)
    person = PersonCursor(Surfaces(LAB))
    person.set_pose(pose)
    target = on_strip(number, position_m)
    cursor = known(person.cursor(ray_to(target, pose, stamp_ns=5)))
    assert (cursor.surface, cursor.stamp_ns) == ("strip", 5)
    assert cursor.point_m is not None
    eyes = vector.add(pose.position_m, EYES)
    assert vector.angle_between(vector.subtract(target, eyes), vector.subtract(cursor.point_m, eyes)) < 1e-6
    if cursor.surface_id == LAB.strips[number].id:
        assert cursor.position_m == pytest.approx(position_m, abs=1e-4)


def offset(angle_deg: float, pose: UserPose) -> PointingRay:
    """Return a ray `angle_deg` above the middle of strip 1, whose nearest point is right below."""
    ray = ray_to(on_strip(1, 2.5), pose)
    azimuth, elevation = vector.azimuth(ray.direction), vector.elevation(ray.direction)
    return PointingRay(
        stamp_ns=0, origin_m=EYES, direction=vector.direction(azimuth, elevation + math.radians(angle_deg))
    )


@pytest.mark.parametrize(("angle_deg", "hit"), [(11.9, True), (12.1, False)])
def test_only_a_ray_within_the_angle_tolerance_hits_the_strip(angle_deg: float, hit: bool) -> None:  # noqa: FBT001
    x, y, _ = on_strip(1, 2.5)
    pose = pose_at((x, y - 3.0, 0.0))
    person = PersonCursor(Surfaces(LAB, tolerance_rad=math.radians(12)))
    person.set_pose(pose)
    cursor = known(person.cursor(offset(angle_deg, pose)))
    assert (cursor.surface == "strip") is hit
    assert (cursor.point_m is not None) is hit


@pytest.mark.parametrize("method", ["exact", "kd_tree"])
def test_metres_forgive_far_away_what_they_refuse_nearby(method: Literal["exact", "kd_tree"]) -> None:
    surfaces = Surfaces(LAB, method=method, tolerance_m=0.7)
    x, y, _ = on_strip(1, 2.5)
    for distance_m, hit in ((6.0, True), (2.0, False)):
        pose = pose_at((x, y - distance_m, 0.0))
        ray = offset(6.0 if hit else 25.0, pose)
        origin = vector.add(pose.position_m, EYES)
        met = surfaces.hit_test(origin, vector.rotate_z(ray.direction, pose.yaw_rad))
        assert (met is not None) is hit
        if met is not None:
            assert met[1].miss_m == pytest.approx(6.0 * math.sin(math.radians(6)), abs=0.06)


def test_ending_takes_back_one_cursor_once_and_never_an_older_stamp() -> None:
    person = PersonCursor(Surfaces(LAB))
    assert person.set_interaction(Interaction(stamp_ns=0, state="pointing")) is None
    person.set_pose(pose_at())
    assert person.cursor(ray_to(on_strip(0, 1.0), pose_at(), stamp_ns=50)) is not None
    ended = known(person.set_interaction(Interaction(stamp_ns=20, state="idle")))
    assert (ended.surface, ended.point_m, ended.stamp_ns) == ("none", None, 50)
    assert person.set_interaction(Interaction(stamp_ns=0, state="localizing")) is None
    assert person.clear(60) is None
    assert person.cursor(ray_to(on_strip(0, 1.0), pose_at())) is None


@given(st.integers(0, 1), st.floats(0.05, 4.95), st.floats(math.radians(-15), math.radians(15)))
def test_at_the_estimated_pose_the_rays_hit_what_is_pointed_at(
    number: int, position_m: float, bias_rad: float
) -> None:
    target = on_strip(number, position_m)
    person = PersonCursor(Surfaces(LAB, ["strip"]))
    person.set_pose(pose_at(bias_rad=bias_rad))
    cursor = known(person.cursor(ray_to(target, pose_at(), bias_rad=bias_rad)))
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
    person.set_pose(pose_at((1.0, 0.5, 0.0), 0.0, bias_rad))
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
        seen = known(person.cursor(ray_to(on_strip(1, 2.5), pose_at())))
        assert seen.point_m is not None
        return round(seen.point_m[0], 6)

    person.set_pose(pose_at((1.0, 0.5, 0.0), stamp_ns=5 * S), now_ns=10 * S)
    tracker = x_m()
    person.set_pose(pose_at((2.0, 0.5, 0.0), stamp_ns=4 * S), now_ns=11 * S)
    assert x_m() == tracker
    person.set_pose(pose_at((2.0, 0.5, 0.0), stamp_ns=6 * S), now_ns=11 * S)
    assert x_m() != tracker
    person.set_pose(
        pose_at((1.0, 0.5, 0.0), stamp_ns=3 * S), now_ns=14 * S
    )  # the other is silent: its clock was ahead
    assert x_m() == tracker
