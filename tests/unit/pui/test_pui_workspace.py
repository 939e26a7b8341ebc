"""Workspaces and lamps through the service: asked for on the bus, refused, seen in cursors."""

from pathlib import Path
from typing import Any

import pytest

from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.schemas import PointingRay, SetWorkspace, TrackedObject, TrackedObjects
from pointit.schemas.topics import OBJECTS, RAY, SET_WORKSPACE
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from tests.unit.pui.room import EYES, Room, room

LAB = load_map("lab", 0)


async def ask(here: Room, user: str = "anna", **query: Any) -> str:
    return (await here.bench.bus.call(SET_WORKSPACE, SetWorkspace(**query), user)).message


async def test_a_workspace_is_laid_through_a_robot_and_left_again() -> None:
    async with room() as here:
        await here.pose()
        drone = TrackedObject(
            id="drone", kind="robot", position_m=(2.0, 1.0, 0.8), velocity_mps=(0.0, 0.0, 0.4)
        )
        here.bench.put(OBJECTS, TrackedObjects(stamp_ns=here.clock.now_ns(), objects=(drone,)), "sim")
        here.clock.advance(0.5)
        await here.point_at(LAB.strips[0].line_m[0])
        said = await ask(here, kind="horizontal", anchor="object", object_id="drone")
        assert said == "anna's cursor moves on a horizontal workspace"
        cursor = await here.point_at((3.0, -1.0, 0.5))
        assert (cursor.surface, cursor.solid, cursor.surface_id) == ("none", "plane", "workspace/horizontal")
        assert cursor.point_m is not None
        assert cursor.point_m[2] == pytest.approx(1.0)
        assert await ask(here, kind="none") == "anna points at the things of the map"
        assert (await here.point_at(LAB.strips[0].line_m[0])).surface == "strip"


async def test_what_cannot_be_is_refused_with_a_sentence() -> None:
    async with room() as here:
        with pytest.raises(RefusedError, match="anna: neither a pose nor a ray has come"):
            await ask(here, kind="sphere")
        here.bench.put(RAY, PointingRay(stamp_ns=0, origin_m=EYES, direction=(1.0, 0.0, 0.0)), "anna")
        await here.bench.settle()
        with pytest.raises(RefusedError, match="anna: no pose is known: localize first"):
            await ask(here, kind="sphere")
        await here.pose()
        await here.point_at((0.0, 0.0, 9.0))
        with pytest.raises(RefusedError, match="anna: there is no cursor now"):
            await ask(here, kind="sphere")
        with pytest.raises(RefusedError, match="anna: no object 'drone' is known"):
            await ask(here, kind="sphere", anchor="object", object_id="drone")
        assert (await here.point_at(LAB.strips[0].line_m[0])).surface == "strip"


async def test_workspace_needs_nothing_else_in_the_map(tmp_path: Path) -> None:
    path = tmp_path / "lamps.yaml"
    path.write_text("leds: {a: {position: [0, 0, 1]}, b: {position: [1, 2, 1]}}", encoding="utf-8")
    Pui.validate_config(PuiConfig(map=str(path), workspace="horizontal"))
    with pytest.raises(ConfigError, match=r"has no strip or belt .*--set pui\.surfaces=\[lamp\]"):
        Pui.validate_config(PuiConfig(map=str(path)))
    async with room(map=str(path), workspace="horizontal") as here:
        await here.pose()
        cursor = await here.point_at((3.0, -1.0, 0.0))
        assert cursor.surface_id == "workspace/horizontal"
        assert cursor.point_m == pytest.approx((3.0, -1.0, 0.0))


async def test_the_configured_workspace_and_lamps() -> None:
    async with room(workspace="sphere", workspace_distance_m=1.5, lamp_angles_deg=180.0) as here:
        await here.pose()
        cursor = await here.point_at((2.0, 1.0, 0.5))
        assert cursor.solid == "sphere"
        assert cursor.range_m == pytest.approx(1.5)
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
