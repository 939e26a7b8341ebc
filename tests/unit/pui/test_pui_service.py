"""The service on a bus: cursors of people, workspaces and the tolerance as asked for, what is refused."""

import asyncio
import functools
import math
import os
import re
from pathlib import Path
from typing import Any

import pytest

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    SetTolerance,
    SetToleranceReply,
    SetWorkspace,
    TrackedObject,
    TrackedObjects,
    UseMap,
)
from pointit.schemas.topics import HEALTH, MAP, OBJECTS, SET_TOLERANCE, SET_WORKSPACE, USE_MAP, USER_ALIVE
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from tests.support import there
from tests.support.bench import in_virtual_time, memory_bench, until
from tests.unit.pui.room import EYES, LAB, Room, S, pose_at, room
from tests.unit.pui.test_cursor import on_strip

PLACE: Vec3 = on_strip(0, 1.5)


async def test_the_map_is_there_for_whoever_comes_late() -> None:
    async with room() as here:
        maps = here.bench.collect(MAP)
        await here.bench.settle()
        assert [(found.name, found.strips) for found in maps] == [("lab", LAB.strips)]


THINGS = """
boxes: {crate: {center: [3, 0, 1], size: [0.5, 2, 2.4]}}
spheres:
  hidden: {center: [6, 0, 1.6], radius: 0.3}
  one: {center: [0, 5, 1.6], radius: 0.2}
  other: {center: [0.6, 5, 1.6], radius: 0.2}
"""


@pytest.mark.parametrize(
    ("target", "config", "met"),
    [
        ((6.0, 0.0, 1.6), {"surfaces": ("sphere",)}, ""),
        ((6.0, 0.0, 1.6), {"surfaces": ("sphere",), "opaque": ()}, "hidden"),
        ((0.0, 5.0, 1.6), {"surfaces": ("sphere",)}, "one"),
        ((0.0, 5.0, 1.6), {"surfaces": ("sphere",), "priority": {"other": 1}}, "other"),
    ],
)
async def test_configured_surfaces_and_priorities_decide_the_hit(
    tmp_path: Path, target: Vec3, config: dict[str, Any], met: str
) -> None:
    path = tmp_path / "things.yaml"
    path.write_text(THINGS)
    async with room(map=str(path), **config) as here:
        await here.pose()
        assert (await here.point_at(target)).surface_id == met


@in_virtual_time
async def test_things_are_listed_again_as_long_as_the_service_runs(tmp_path: Path) -> None:
    path = tmp_path / "shelf.yaml"
    path.write_text("things: {screws: {center: [2.6, 0, 1.4], size: [0.4, 0.4, 0.3]}}")
    async with memory_bench(VirtualClock()) as bench:
        listed = bench.collect(OBJECTS, "things")
        bench.start(Pui, PuiConfig(map=str(path)))
        await asyncio.sleep(1.0)
    assert [[each.id for each in one.objects] for one in listed] == [["screws"]] * 3
    assert listed[-1].stamp_ns - listed[0].stamp_ns == pytest.approx(0.8 * S, abs=0.01 * S)


@pytest.mark.parametrize(("center", "met"), [("[2, 0, 1]", "pot"), ("[2, 0.1, 0.5]", "")])
async def test_things_are_hit_except_on_belts_and_at_tracked_objects(
    tmp_path: Path, center: str, met: str
) -> None:
    path = tmp_path / "things.yaml"
    path.write_text(
        "belts: {main: {centerline: [[2, -1, 0.5], [2, 1, 0.5]], width: 0.4}}\n"
        f"things: {{pot: {{center: {center}, size: [1, 1, 1]}}, agv: {{at: object}}}}"
    )
    async with room(map=str(path), surfaces=("strip",)) as here:
        await here.pose(pose=pose_at((0.0, 0.0, 0.0), 0.0))
        assert (await here.point_at((2.0, 0.1, 0.5))).surface_id == met
        assert (await here.point_at((0.05, 0.0, 0.0))).surface_id == ""


async def test_missing_pose_gives_no_cursor_and_a_reason_in_health() -> None:
    async with room() as here:
        await here.aim(PLACE)
        assert here.cursors == []
        await here.until_health(lambda warnings: any("anna" in text for text in warnings))
        await here.pose()
        assert (await here.point_at(PLACE)).surface == "strip"
        assert len(here.cursors) == 1
        await here.until_health(lambda warnings: warnings == ())


async def test_health_advises_localizing_after_a_minute_without_a_hit() -> None:
    async with room() as here:
        await here.pose()
        for _ in range(620):
            here.clock.advance(0.08)
            await here.point(vector.direction(0.0, math.radians(60.0)))
        hint = re.compile(
            r"anna has pointed past everything for a minute \(you point \d+° above .*: lower your arm\): "
            r"localize again .*`pointit person calibrate mounting anna`"
        )
        await here.until_health(lambda warnings: any(hint.match(text) for text in warnings))
        await here.point_at(PLACE)
        await here.until_health(lambda warnings: warnings == ())


async def test_a_cursor_only_while_pointing() -> None:
    async with room() as here:
        await here.pose()
        await here.interact("idle")
        await here.aim(PLACE)
        assert here.cursors == []
        await here.interact("pointing")
        shown_ns = await here.aim(PLACE)
        here.clock.advance(0.01)
        await here.interact("localizing")
        await here.aim(PLACE)
        await here.aim(PLACE, "ben")
        seen = [(cursor.surface, cursor.seq) for cursor in here.of["anna"]]
        assert (seen, here.of["anna"][-1].stamp_ns) == ([("strip", 1), ("none", 2)], shown_ns + 10_000_000)


async def test_localizing_person_is_not_warned_of_a_missing_pose() -> None:
    async with room() as here:
        await here.aim(PLACE)  # before the supervisor said anything: warned
        await here.interact("localizing")
        await here.aim(PLACE)
        await here.until_health(lambda warnings: warnings == ())


async def test_cursor_leaves_with_the_person_and_returns_with_them() -> None:
    async with room() as here:
        present = here.bench.bus.announce(USER_ALIVE, "anna")
        await here.pose()
        await here.aim(PLACE)
        present.close()
        await here.bench.settle()
        here.bench.bus.announce(USER_ALIVE, "anna")
        await here.bench.settle()
        await here.aim(PLACE)
        assert [cursor.surface for cursor in here.of["anna"]] == ["strip", "none", "strip"]


# the tolerance

ABOVE_M = (4.85, 1.0, 0.9)


async def tolerate(here: Room, tolerance_deg: float | None = None) -> SetToleranceReply:
    tolerance_rad = None if tolerance_deg is None else math.radians(tolerance_deg)
    return await here.bench.bus.call(SET_TOLERANCE, SetTolerance(tolerance_rad=tolerance_rad))


async def beside(here: Room, beside_deg: float, user: str = "anna") -> str:
    reach = vector.subtract(ABOVE_M, EYES)
    raised = vector.elevation(reach) + math.radians(beside_deg)
    await here.pose(user)
    return (await here.point(vector.direction(vector.azimuth(reach), raised), user)).surface


async def test_it_holds_for_everybody_from_the_next_ray_on() -> None:
    async with room() as here:
        reply = await tolerate(here)
        assert reply.tolerance_rad == pytest.approx(math.radians(12.0))
        assert "12.0°" in reply.message
        assert await beside(here, 8.0) == "strip"

        reply = await tolerate(here, 5.0)
        assert reply.tolerance_rad == pytest.approx(math.radians(5.0))
        assert [await beside(here, 8.0), await beside(here, 8.0, "ben")] == ["none", "none"]
        assert await beside(here, 3.0) == "strip"

        await tolerate(here, 20.0)
        assert [await beside(here, 15.0), await beside(here, 15.0, "ben")] == ["strip", "strip"]
        assert (await tolerate(here)).tolerance_rad == pytest.approx(math.radians(20.0))

        reports = here.bench.collect(HEALTH)
        await until(lambda: bool(reports))
        figures = [(each.name, each.value, each.unit) for each in reports[-1].figures]
        assert ("default tolerance", 12.0, "°") in figures, "that of the start"


# workspaces


async def ask(here: Room, user: str = "anna", **query: Any) -> str:
    return (await here.bench.bus.call(SET_WORKSPACE, SetWorkspace(**query), user)).message


async def test_a_workspace_is_laid_through_a_robot_and_left_again() -> None:
    async with room() as here:
        await here.pose()
        at_m = (2.0, 1.0, 0.8)
        speed = (0.0, 0.0, 0.4)
        drone = TrackedObject(id="drone", kind="robot", position_m=at_m, velocity_mps=speed)
        here.bench.put(OBJECTS, TrackedObjects(stamp_ns=here.clock.now_ns(), objects=(drone,)), "sim")
        here.clock.advance(0.48)
        await here.point_at(LAB.strips[0].line_m[0])

        said = await ask(here, kind="horizontal", anchor="object", object_id="drone")
        assert said == "anna's cursor moves on a horizontal workspace"
        cursor = await here.point_at((3.0, -1.0, 0.5))
        assert (cursor.surface, cursor.solid, cursor.surface_id) == ("none", "plane", "workspace/horizontal")
        assert there(cursor.point_m)[2] == pytest.approx(1.0, abs=0.01)
        with pytest.raises(RefusedError, match="anna: no object 'rover' is known"):
            await ask(here, kind="sphere", anchor="object", object_id="rover")
        assert await ask(here, kind="none") == "anna points at the things of the map"
        assert (await here.point_at(LAB.strips[0].line_m[0])).surface == "strip"


async def test_workspace_needs_nothing_else_in_the_map(tmp_path: Path) -> None:
    path = tmp_path / "lamps.yaml"
    path.write_text("lamps: {a: {position: [0, 0, 1]}, b: {position: [1, 2, 1]}}", encoding="utf-8")
    Pui.validate_config(PuiConfig(map=str(path), workspace="horizontal"))
    with pytest.raises(ConfigError, match=r"has no strip or belt .*--set pui\.surfaces=\[lamp\]"):
        Pui.validate_config(PuiConfig(map=str(path)))
    async with room(map=str(path), workspace="horizontal") as here:
        await here.pose()
        cursor = await here.point_at((3.0, -1.0, 0.0))
        assert cursor.surface_id == "workspace/horizontal"
        assert cursor.point_m == pytest.approx((3.0, -1.0, 0.0))


async def test_the_configured_workspace_and_lamps() -> None:
    async with room(workspace="sphere", lamp_angles_deg=180.0) as here:
        await here.pose()
        cursor = await here.point_at((2.0, 1.0, 0.5))
        assert cursor.solid == "sphere"
        assert cursor.range_m == pytest.approx(2.0)
        assert {lamp.id for lamp in cursor.lamps} == {lamp.id for lamp in LAB.lamps}
    async with room() as here:
        await here.pose()
        assert (await here.point_at((2.0, 1.0, 0.5))).lamps == ()


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"map": "absent.yaml"}, r"absent\.yaml: cannot be read"),
        ({"priority": {"strp": 1}}, "^priority: 'strp' is neither a kind nor the id"),
        ({"priority": {"Lamp": 1}}, "^priority: 'Lamp' is neither a kind nor the id"),
    ],
)
def test_parameters_that_do_not_fit_are_refused_before_pui_joins(config: dict[str, Any], said: str) -> None:
    Pui.validate_config(PuiConfig())
    with pytest.raises(ConfigError, match=said):
        Pui.validate_config(PuiConfig(**config))


STRIP = "strips: {{s: {{line: [[2, -1, {z}], [2, 1, {z}]], pixels: 60}}}}"
THING = "things: {{pot: {{center: [{x}, 2, 1], size: [0.2, 0.2, 0.2]}}}}"


async def test_changed_map_is_used_at_once_and_keeps_the_tolerance(tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(STRIP.format(z=1))
    async with room(map=str(path)) as here:
        maps = here.bench.collect(MAP)
        await tolerate(here, 3.0)
        await here.pose()
        assert (await here.point_at((2.0, 0.5, 1.5))).surface_id == ""
        assert (await here.bench.bus.call(USE_MAP, UseMap())).path == str(path)
        path.write_text(STRIP.format(z=1.5))
        assert (await here.bench.bus.call(USE_MAP, UseMap(path=str(path)))).path == str(path)
        await here.bench.settle()
        assert (await here.point_at((2.0, 0.5, 1.5))).surface_id == "s"
        assert [each.strips[0].line_m[0][2] for each in maps] == [1.0, 1.5]
        assert (await tolerate(here)).tolerance_rad == pytest.approx(math.radians(3.0))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("strips: {s: {line: 7, pixels: 60}}", "strips.s.line"), ("lamps: {a: {position: [0, 0, 1]}}", "lamp")],
)
async def test_unusable_map_is_refused_and_the_old_one_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    other = tmp_path / "other.yaml"
    other.write_text(text)
    async with room() as here:
        maps = here.bench.collect(MAP)
        with pytest.raises(RefusedError, match=sentence):
            await here.bench.bus.call(USE_MAP, UseMap(path=str(other)))
        await here.pose()
        assert (await here.point_at(PLACE)).surface == "strip"
        assert (await here.bench.bus.call(USE_MAP, UseMap())).path == "lab"
        assert [each.name for each in maps] == ["lab"]


async def test_operators_read_no_files_but_maps_of_the_runs_folder(tmp_path: Path) -> None:
    maps = tmp_path / "maps"
    elsewhere = tmp_path / "elsewhere"
    maps.mkdir()
    elsewhere.mkdir()
    (maps / "room.yaml").write_text(STRIP.format(z=1))
    foreign = '{"operator": "s3cret-t0ken"}'
    for path in (maps / "tokens.json", maps / "tokens.yaml", elsewhere / "tokens.yaml"):
        path.write_text(foreign)
    (elsewhere / "room.yaml").write_text(STRIP.format(z=2))
    (maps / "link.yaml").symlink_to(elsewhere / "room.yaml")
    os.mkfifo(maps / "pipe.yaml")
    (maps / "mixed.yaml").write_text(STRIP.format(z=1) + "\npassword: s3cret-t0ken\n")
    async with room(map=str(maps / "room.yaml")) as here:
        for name in (
            *("maps/tokens.json", "maps/tokens.yaml", "elsewhere/tokens.yaml", "elsewhere/room.yaml"),
            *("maps/link.yaml", "maps/pipe.yaml", "maps/mixed.yaml", "maps/../elsewhere/room.yaml", "maps"),
        ):
            with pytest.raises(RefusedError) as refused:
                await here.bench.bus.call(USE_MAP, UseMap(path=str(tmp_path / name)))
            assert "s3cret" not in str(refused.value), name
            assert refused.match("is not a YAML file in|is not a map|is not a section of maps"), name
        assert (await here.bench.bus.call(USE_MAP, UseMap(path="lab"))).path == "lab"


def lists(listed: list[TrackedObjects], ids: list[str]) -> bool:
    return bool(listed) and [each.id for each in listed[-1].objects] == ids


async def test_things_of_a_new_map_replace_those_before(tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(STRIP.format(z=1))
    async with room(map=str(path)) as here:
        listed = here.bench.collect(OBJECTS, "things")
        for text, ids in ((THING.format(x=2), ["pot"]), (STRIP.format(z=1), list[str]())):
            path.write_text(text)
            await here.bench.bus.call(USE_MAP, UseMap(path=str(path)))
            await until(functools.partial(lists, listed, ids))
