"""A map out of the parameters of a genuine rclpy node, as `pointit map fetch --backend.kind dds` takes it."""

from collections.abc import Generator
from pathlib import Path

import pytest
import yaml

from pointit.bridges.ros2.parameters.map_parameters import parameters_of, tree_of
from pointit.maps.file import map_path
from tests.interop.ros2_dds.driven import Driven

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]  # the first may fetch for a minute

TEXT = "leds: {door: {position: [-1.5, 3.2, 1.8]}}\n"


@pytest.fixture
def theirs(rclpy_python: Path, tmp_path: Path) -> Generator[Driven]:
    robot = Driven(rclpy_python, tmp_path, "rclpy_peer.py", "robot")
    try:
        robot.wait()
        yield robot
    finally:
        robot.kill()


@pytest.fixture
def ours(rclpy_python: Path, tmp_path: Path) -> Generator[Driven]:
    side = Driven(rclpy_python, tmp_path, "bridge_side.py", "/site1/pointit")
    try:
        side.wait()
        yield side
    finally:
        side.kill()


async def test_a_map_comes_out_of_a_genuine_nodes_parameters(ours: Driven, theirs: Driven) -> None:
    with map_path("conveyor") as path:
        parameters = parameters_of(yaml.safe_load(path.read_text(encoding="utf-8")))
    await theirs.do("declare", parameters=parameters | {"room": TEXT})
    values = {"node": "/robot", "parameter": None, "prefix": None, "timeout_s": 20.0}
    assert await ours.do("fetch", **values) == tree_of(parameters)
    room = {"leds": {"door": {"position": [-1.5, 3.2, 1.8]}}}
    assert await ours.do("fetch", **values | {"parameter": "room"}) == room
    with pytest.raises(AssertionError, match="NoAnswerError: there is no node /robbot in domain"):
        await ours.do("fetch", **values | {"node": "/robbot", "timeout_s": 4.0})
    with pytest.raises(
        AssertionError, match=r"ConfigError: no parameter of /robot begins with 'site\.'; it has use"
    ):
        await ours.do("fetch", **values | {"prefix": "site"})
