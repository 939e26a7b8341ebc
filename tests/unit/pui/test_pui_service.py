"""Cursors: where they are, for whom, when there are none; the service on a bus."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.file import load_map
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import Cursor, Interaction, PointingRay, UserPose
from pointit.schemas.topics import CURSOR, HEALTH, INTERACTION, MAP, POSE, RAY, USER_ALIVE
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.service import Pui
from pointit.services.pui.surfaces import Surfaces
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.support.data import data_file
from tests.support.known import known

LAB = load_map("lab", 0)
EYES: Vec3 = (0.0, 0.0, 1.64)
AT: Vec3 = (1.0, 0.5, 0.0)


def ray_to(target: Vec3, pose: UserPose, stamp_ns: int = 0) -> PointingRay:
    """Return the ray in {H} of a person at `pose` who points at `target` in {W}."""
    eyes = vector.add(pose.position_m, vector.rotate_z(EYES, pose.yaw_rad))
    reach = vector.normalized(vector.subtract(target, eyes))
    return PointingRay(stamp_ns=stamp_ns, origin_m=EYES, direction=vector.rotate_z(reach, -pose.yaw_rad))


def pose_at(position_m: Vec3 = AT, yaw_rad: float = 0.7) -> UserPose:
    return UserPose(stamp_ns=0, position_m=position_m, yaw_rad=yaw_rad)


def interaction(state: Literal["idle", "localizing", "pointing"], stamp_ns: int = 0) -> Interaction:
    return Interaction(stamp_ns=stamp_ns, state=state)


def on_strip(number: int, position_m: float) -> Vec3:
    return Polyline(LAB.strips[number].line_m).point_at(position_m)


# the core


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


def test_the_cursors_numbers_are_those_of_its_point() -> None:
    pose = pose_at((2.0, 1.0, 0.0), yaw_rad=0.0)
    person = PersonCursor(Surfaces(LAB))
    person.set_pose(pose)
    beside = vector.add(on_strip(0, 2.0), (0.0, 0.0, 0.3))  # 0.3 m above the strip
    cursor = known(person.cursor(ray_to(beside, pose)))
    assert cursor.point_m is not None
    eyes = (2.0, 1.0, 1.64)
    reach = vector.subtract(cursor.point_m, eyes)
    aim = vector.subtract(beside, eyes)
    assert cursor.range_m == pytest.approx(vector.norm(reach))
    assert cursor.miss_rad == pytest.approx(vector.angle_between(reach, aim))
    assert cursor.miss_m == pytest.approx(cursor.range_m * math.sin(cursor.miss_rad))
    assert 0.05 < cursor.miss_rad < math.radians(12)


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


def test_only_the_wanted_kinds_take_part() -> None:
    lamp = LAB.lamps[1]
    direction = vector.normalized(vector.subtract(lamp.position_m, EYES))
    met = known(Surfaces(LAB, ["lamp"]).hit_test(EYES, direction))
    assert met[0] == ("lamp", lamp.id)
    assert Surfaces(LAB, ["strip"]).hit_test(EYES, direction) is None


def test_belts_and_strips_of_the_conveyor_are_told_apart() -> None:
    conveyor = load_map(str(data_file("pointit-ros2/belt.yaml")), 0)
    surfaces = Surfaces(conveyor, ["strip", "belt"])
    eyes = (0.8, -1.2, 1.64)
    for kind, entries in (("strip", conveyor.strips), ("belt", conveyor.belts)):
        for entry in entries:
            line = Polyline(entry.line_m)
            reach = vector.subtract(line.point_at(line.length_m / 2), eyes)
            met = known(surfaces.hit_test(eyes, vector.normalized(reach)))
            if met[0] != (kind, entry.id):  # then another is in the same line of sight
                assert met[1].miss_rad < 1e-3
            else:
                assert met[1].position_m == pytest.approx(line.length_m / 2, abs=0.005)


def test_ending_takes_back_one_cursor_once_and_never_an_older_stamp() -> None:
    person = PersonCursor(Surfaces(LAB))
    assert person.set_interaction(interaction("pointing")) is None
    person.set_pose(pose_at())
    assert person.cursor(ray_to(on_strip(0, 1.0), pose_at(), stamp_ns=50)) is not None
    ended = known(person.set_interaction(interaction("idle", stamp_ns=20)))
    assert (ended.surface, ended.point_m, ended.stamp_ns) == ("none", None, 50)
    assert person.set_interaction(interaction("localizing")) is None
    assert person.clear(60) is None
    assert person.cursor(ray_to(on_strip(0, 1.0), pose_at())) is None


# the service


class Room:
    """A running pui and what it wrote, by person."""

    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        self.bench = bench
        self.clock = clock
        self.cursors: dict[str, list[Cursor]] = {}
        bench.bus.subscribe(CURSOR, lambda cursor, user: self.cursors.setdefault(user, []).append(cursor))

    async def point(self, user: str, target: Vec3, pose: UserPose | None = None) -> int:
        stamp_ns = self.clock.advance(0.02)
        self.bench.put(RAY, ray_to(target, pose or pose_at(), stamp_ns), user)
        await self.bench.settle()
        return stamp_ns


async def room_of(bench: Bench, clock: ManualClock, **config: Any) -> Room:
    room = Room(bench, clock)
    bench.start(Pui, PuiConfig(**config))
    await bench.settle()
    return room


async def test_the_map_is_there_for_whoever_comes_late() -> None:
    async with memory_bench() as bench:
        await room_of(bench, ManualClock())
        maps = bench.collect(MAP)
        await bench.settle()
        assert [(found.name, found.strips) for found in maps] == [("lab", LAB.strips)]


THINGS = """
boxes: {crate: {center: [3, 0, 1], size: [0.5, 2, 2.4]}}
planes: {floor: {center: [0, 0, 0], normal: [0, 0, 1]}}
spheres:
  hidden: {center: [6, 0, 1.6], radius: 0.3}
  one: {center: [0, 5, 1.6], radius: 0.2}
  other: {center: [0.6, 5, 1.6], radius: 0.2}
"""
FLAT: Vec3 = (-1.64 / math.tan(math.radians(15.0)), 0.0, 0.0)


@pytest.mark.parametrize(
    ("target", "config", "met"),
    [
        ((6.0, 0.0, 1.6), {"surfaces": ("sphere",)}, ""),
        ((6.0, 0.0, 1.6), {"surfaces": ("sphere",), "opaque": ()}, "hidden"),
        ((0.0, 5.0, 1.6), {"surfaces": ("sphere",)}, "one"),
        ((0.0, 5.0, 1.6), {"surfaces": ("sphere",), "priority": {"other": 1}}, "other"),
        (FLAT, {"surfaces": ("plane",), "grazing_deg": 14.0}, "floor"),
        (FLAT, {"surfaces": ("plane",), "grazing_deg": 16.0}, ""),
    ],
)
async def test_what_is_configured_decides_what_is_met(
    tmp_path: Path, target: Vec3, config: dict[str, Any], met: str
) -> None:
    path = tmp_path / "things.yaml"
    path.write_text(THINGS)
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = await room_of(bench, clock, map=str(path), **config)
        here = pose_at((0.0, 0.0, 0.0))
        bench.put(POSE, here, "anna")
        await bench.settle()
        await room.point("anna", target, here)
        assert [cursor.surface_id for cursor in room.cursors["anna"]] == [met]


async def test_two_people_have_their_own_cursors() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = await room_of(bench, clock)
        anna, ben = pose_at((1.0, 0.5, 0.0), 0.7), pose_at((3.0, 2.0, 0.0), -2.0)
        bench.put(POSE, anna, "anna")
        bench.put(POSE, ben, "ben")
        await bench.settle()
        first = await room.point("anna", on_strip(0, 1.5), anna)
        second = await room.point("ben", on_strip(1, 4.0), ben)
        assert set(room.cursors) == {"anna", "ben"}
        (one,), (two,) = room.cursors["anna"], room.cursors["ben"]
        assert (one.surface_id, one.stamp_ns) == ("0", first)
        assert one.position_m == pytest.approx(1.5)
        assert (two.surface_id, two.stamp_ns) == ("1", second)
        assert two.position_m == pytest.approx(4.0)


async def health_says(bench: Bench, condition: Callable[[tuple[str, ...]], bool]) -> None:
    reports = bench.collect(HEALTH, "pui")
    await until(lambda: bool(reports) and condition(reports[-1].warnings), what="health")


async def test_without_a_pose_there_is_no_cursor_and_health_says_why() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = await room_of(bench, clock)
        await room.point("anna", on_strip(0, 1.5))
        assert room.cursors == {}
        await health_says(bench, lambda warnings: any("anna" in text for text in warnings))
        bench.put(POSE, pose_at(), "anna")
        await room.point("anna", on_strip(0, 1.5))
        assert [cursor.surface for cursor in room.cursors["anna"]] == ["strip"]
        await health_says(bench, lambda warnings: warnings == ())


async def test_a_cursor_only_while_pointing() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = await room_of(bench, clock)
        bench.put(POSE, pose_at(), "anna")
        bench.put(INTERACTION, interaction("idle"), "anna")
        await bench.settle()
        await room.point("anna", on_strip(0, 1.5))
        assert room.cursors == {}
        bench.put(INTERACTION, interaction("pointing"), "anna")
        await bench.settle()
        await room.point("anna", on_strip(0, 1.5))
        bench.put(INTERACTION, interaction("localizing", clock.advance(0.01)), "anna")
        await bench.settle()
        await room.point("anna", on_strip(0, 1.5))
        await room.point("ben", on_strip(0, 1.5))
        assert [cursor.surface for cursor in room.cursors["anna"]] == ["strip", "none"]
        assert room.cursors["anna"][-1].stamp_ns == clock.now_ns() - 40_000_000
        assert [cursor.seq for cursor in room.cursors["anna"]] == [1, 2]


async def test_somebody_who_localizes_is_not_told_that_a_pose_is_missing() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = await room_of(bench, clock)
        await room.point("anna", on_strip(0, 1.5))  # before the supervisor said anything: warned
        bench.put(INTERACTION, interaction("localizing"), "anna")
        await bench.settle()
        await room.point("anna", on_strip(0, 1.5))
        await health_says(bench, lambda warnings: warnings == ())


async def test_the_cursor_goes_with_the_person_and_comes_back_with_them() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = await room_of(bench, clock)
        here = bench.bus.announce(USER_ALIVE, "anna")
        bench.put(POSE, pose_at(), "anna")
        await bench.settle()
        await room.point("anna", on_strip(0, 1.5))
        here.close()
        await bench.settle()
        bench.bus.announce(USER_ALIVE, "anna")
        await bench.settle()
        await room.point("anna", on_strip(0, 1.5))
        assert [cursor.surface for cursor in room.cursors["anna"]] == ["strip", "none", "strip"]


@pytest.mark.parametrize("method", ["exact", "kd_tree"])
async def test_no_ray_makes_a_cursor_that_is_not_a_number(method: str) -> None:
    # cursors are strict and finite: one with a NaN would raise in the handler and count as an error
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        room = await room_of(bench, clock, method=method, surfaces=("strip", "lamp"))
        on_a_lamp = vector.subtract(LAB.lamps[0].position_m, EYES)
        on_the_strip = vector.subtract(on_strip(0, 2.0), EYES)
        rays = 0
        for position in (on_a_lamp, on_the_strip, (4.85, -5.0, -0.74)):  # the last: in line with strip 0
            pose = pose_at(position, 0.0)
            bench.put(POSE, pose, "anna")
            await bench.settle()
            for direction in ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (0.6, 0.0, 0.8)):
                ray = PointingRay(stamp_ns=clock.advance(0.02), origin_m=EYES, direction=direction)
                bench.put(RAY, ray, "anna")
                await bench.settle()
                rays += 1
        assert len(room.cursors["anna"]) == rays


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"map": "nowhere.yaml"}, r"nowhere\.yaml: cannot be read"),
        (
            {"surfaces": ("belt",)},
            r"no belt to point at; use what it has \(--set pui.surfaces=\[strip,lamp\]\) or another map",
        ),
    ],
)
async def test_a_broken_map_or_useless_surfaces_end_the_service_with_a_sentence(
    config: dict[str, Any], said: str
) -> None:
    clock = ManualClock()
    bus = MemoryBus()
    try:
        launch = Launch(service=Pui, config=PuiConfig(**config))
        with pytest.raises(ConfigError, match=said):
            await run_service(launch, bus, clock)
    finally:
        await bus.close()
