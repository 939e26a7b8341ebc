"""`pointit map fetch` as a process in a ROS graph on Zenoh, whose other nodes are ours too."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.map_parameters import FetchRequest, fetched
from pointit.bridges.ros2.types.types import Types
from pointit.maps.file import load_map, map_path
from pointit.runtime.config.yaml_file import parse_yaml
from pointit.runtime.errors import ConnectError
from tests.integration.ros2.nodes import DOMAIN, Graphs, graphs
from tests.support.commands import Commands
from tests.support.data import data_file
from tests.support.parameter_server import NODE, ParameterServer, parameters_of

TYPES = Types("jazzy")
PATIENT_S = 20.0


def options(endpoint: str, domain: int = DOMAIN) -> tuple[str, ...]:
    return ("--backend.endpoint", endpoint, "--backend.domain-id", f"{domain}", "--timeout", f"{PATIENT_S}")


def wish(node: str = NODE, timeout_s: float = PATIENT_S) -> FetchRequest:
    return FetchRequest(node=node, parameter=None, usual="map", prefix=None, timeout_s=timeout_s)


def config(at: Graphs, **settings: Any) -> BackendConfig:
    values: dict[str, Any] = {"endpoint": at.endpoint, "domain_id": DOMAIN, "mode": "client", "node": "/asks"}
    return BackendConfig.model_validate(values | settings)


async def test_a_map_in_many_parameters_becomes_a_file(commands: Commands, tmp_path: Path) -> None:
    path = tmp_path / "conveyor.yaml"
    with map_path("conveyor") as shipped:
        tree = yaml.safe_load(shipped.read_text(encoding="utf-8"))
    async with graphs() as at:
        node = await at.node(NODE, "router")
        server = ParameterServer(TYPES, {"use_sim_time": False, **parameters_of(tree)})
        server.serve(node.backend, NODE)
        done = await commands.pointit("map", "fetch", "pui", "-o", f"{path}", *options(at.endpoint))
        assert done.code == 0, done
        assert done.err in ("", "asking /pui for its parameters …\n"), "where it takes long"
        assert len(server.asked) > 3, "page by page"
        assert not node.shown.ever

    assert load_map(f"{path}", 0) == load_map("conveyor", 0)
    checked = await commands.pointit("map", "check", f"{path}")
    assert (checked.code, checked.out) == (0, done.out)


async def test_map_in_one_text_parameter_is_printed(commands: Commands) -> None:
    text = data_file("pointit-ros2/belt.yaml").read_text(encoding="utf-8")
    async with graphs() as at:
        node = await at.node(NODE, "router")
        ParameterServer(TYPES, {"map": text}).serve(node.backend, NODE)
        done = await commands.pointit("map", "fetch", NODE, *options(at.endpoint))
    assert done.code == 0
    theirs = parse_yaml(text.encode(), "theirs")
    assert {
        section: {str(name): entry for name, entry in entries.items()} for section, entries in theirs.items()
    } == {
        section: {str(name): entry for name, entry in entries.items()}
        for section, entries in parse_yaml(done.out.encode(), "ours").items()
    }
    assert "the map of /pui: " in done.err


async def test_missing_router_is_reported_within_seconds(commands: Commands, endpoint: str) -> None:
    with pytest.raises(ConnectError) as caught:
        await fetched(BackendConfig(endpoint=endpoint, mode="client"), wish())
    assert str(caught.value) == (
        f"nobody answers at {endpoint}: start one with `ros2 run rmw_zenoh_cpp rmw_zenohd`, or set mode to "
        "router to be it; --backend.endpoint says where it is"
    )
    done = await commands.pointit("map", "fetch", NODE, *options(endpoint))
    assert (done.code, done.out, done.sentence) == (1, "", str(caught.value))
    assert f"looking for a ROS router at {endpoint} …" in done.err
