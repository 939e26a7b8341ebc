"""An independent ROS node tells its parameters: a map comes out of them."""

from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from pointit.bridges.ros2.parameters.map_parameters import parameters_of
from pointit.bridges.ros2.parameters.node_parameters import GET, GET_SUFFIX, LIST, LIST_SUFFIX
from pointit.bridges.ros2.parameters.values import MESSAGE, message_of
from pointit.maps.file import load_map
from tests.integration.ros2.nodes import graphs
from tests.interop.ros2.ament import shape
from tests.interop.ros2.peers import DOMAIN, TYPES, Dora
from tests.support.commands import Commands, Ended

pytestmark = pytest.mark.timeout(600)  # .venv-peers may have to be made

ROOM = """\
leds: {door: {position: [-1.5, 3.25, 1.75]}, window: {position: [2.0, -1.0, 1.0]}}
strips: {1: {line: [[0.0, 0.6, 1.0], [3.0, 0.6, 1.0]], pixels: 90, direction: -1}}
bays: {a: main}
belts: {main: {centerline: [[0.0, 0.0, 1.0], [3.0, 0.0, 1.0]], width: 1.0}}
"""
TREE: dict[str, Any] = {
    "leds": {"door": {"position": [-1.5, 3.25, 1.75]}, "window": {"position": [2.0, -1.0, 1.0]}},
    "strips": {"1": {"line": [[0.0, 0.6, 1.0], [3.0, 0.6, 1.0]], "pixels": 90, "direction": -1}},
    "belts": {"main": {"centerline": [[0.0, 0.0, 1.0], [3.0, 0.0, 1.0]], "width": 1.0}},
    "bays": {"a": "main"},
}


class Pui:
    """A peer's node with parameters, in a graph whose router is ours."""

    def __init__(self, dora: Dora, commands: Commands, endpoint: str, folder: Path) -> None:
        self._dora = dora
        self._commands = commands
        self._endpoint = endpoint
        self.path = folder / "site.yaml"

    async def has(self, parameters: dict[str, Any], wanted: list[str]) -> None:
        """Tell all names, and for the values of those that are `wanted`, which is the one page that comes."""
        await self._dora.serves(f"/pui{LIST_SUFFIX}", LIST, result={"names": [*parameters], "prefixes": []})
        values = [_fields(parameters[name]) for name in wanted]
        await self._dora.serves(f"/pui{GET_SUFFIX}", GET, values=values)

    async def fetch(self) -> Ended:
        settings = (
            "--backend.endpoint",
            self._endpoint,
            "--backend.domain-id",
            f"{DOMAIN}",
            "--timeout",
            "20",
        )
        return await self._commands.pointit("map", "fetch", "pui", "-o", f"{self.path}", *settings)

    async def asked(self) -> Any:
        return await self._dora.do("asked", service=f"/pui{GET_SUFFIX}")


def _fields(value: Any) -> dict[str, Any]:
    message = message_of(TYPES, value)
    fields = {name: getattr(message, name) for name in shape(TYPES, MESSAGE)}
    return {name: each.tolist() if hasattr(each, "tolist") else each for name, each in fields.items()}


@pytest_asyncio.fixture
async def pui(tmp_path: Path, peers_python: Path, commands: Commands) -> AsyncGenerator[Pui]:
    async with graphs() as at:
        await at.node("/router", "router")
        dora = Dora(peers_python, tmp_path, at.endpoint, "pui")
        try:
            dora.start()
            yield Pui(dora, commands, at.endpoint, tmp_path)
        finally:
            dora.kill()


async def test_a_map_in_many_parameters_of_the_peer(pui: Pui) -> None:
    parameters = parameters_of(TREE)
    await pui.has({"use_sim_time": False, **parameters}, list(parameters))
    done = await pui.fetch()
    assert (done.code, done.err) == (0, ""), done
    assert [each["names"] for each in await pui.asked()] == [list(parameters)]
    _is_the_room(pui.path)


async def test_a_map_in_one_text_of_the_peer(pui: Pui) -> None:
    await pui.has({"use_sim_time": False, "map": ROOM}, ["map"])
    done = await pui.fetch()
    assert (done.code, done.err) == (0, ""), done
    assert [each["names"] for each in await pui.asked()] == [["map"]]
    _is_the_room(pui.path)


def _is_the_room(path: Path) -> None:
    by_hand = path.with_name("by_hand.yaml")
    by_hand.write_text(ROOM, encoding="utf-8")
    expected = load_map(f"{by_hand}", 0).model_copy(update={"name": path.stem})
    fetched = load_map(f"{path}", 0)
    assert fetched.belts == expected.belts
    assert fetched.strips == expected.strips
    assert fetched == expected
