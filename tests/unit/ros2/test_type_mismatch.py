"""Findings about another type or definition under a name of ours agree with the delivery of messages."""

import pytest

from pointit.bridges.ros2.graph.backend import LATCHED, SENSOR, Graph, RosType
from pointit.bridges.ros2.graph.findings import Finding, Matching, findings
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import RmwZenoh
from tests.support.bench import until
from tests.unit.ros2 import fake_rclpy
from tests.unit.ros2.rclpy_bench import BOOL, QOS, node_of_ours, on_a_wire, profile
from tests.unit.ros2.test_graph import BOOL as OTHER_TYPE
from tests.unit.ros2.test_graph import OTHER, end

pytestmark = pytest.mark.wall_time


class Rebuilt(fake_rclpy.Bool):
    HASH = "RIHS01_" + "0" * 64


def found(of: RosType, matching: Matching) -> dict[str, Finding]:
    ends = frozenset((end(qos=LATCHED), end("publisher", "/robot", of, qos=SENSOR)))
    result = findings(Graph(nodes=frozenset(), endpoints=ends), domain=7, distro="jazzy", matching=matching)
    return {each.about: each for each in result}


@pytest.mark.parametrize(
    ("of", "matching", "says"),
    [
        (OTHER, "definition", "and nothing arrives"),
        (OTHER, "type", "and what arrives is dropped or misread"),
        (OTHER_TYPE, "definition", "nothing arrives"),
        (OTHER_TYPE, "type", "nothing arrives"),
    ],
)
def test_whether_anything_arrives_is_told(of: RosType, matching: Matching, says: str) -> None:
    result = found(of, matching)
    about = "definition of /x" if of == OTHER else "type of /x"
    assert says in result[about].sentence
    arrives = "nothing" not in says
    assert ("QoS of /x" in result) == arrives, "where nothing arrives anyhow, that is nothing to speak of"
    assert ("nobody publishes" in result) != arrives


def test_rmw_zenoh_keeps_definitions_apart() -> None:
    rmw = RmwZenoh(session="ab", node="/pointit", domain=7)
    assert len({rmw.key("/x", each) for each in (BOOL, OTHER, OTHER_TYPE)}) == 3


async def test_dds_brings_messages_of_another_definition(monkeypatch: pytest.MonkeyPatch) -> None:
    wire = on_a_wire(monkeypatch)
    async with node_of_ours() as ours:
        heard: list[bytes] = []
        ours.backend.subscribe("/in", BOOL, QOS, heard.append)
        publisher = wire.node("robot").create_publisher(Rebuilt, "/in", profile())
        publisher.publish(b"\0\1\0\0\1")
        await until(lambda: bool(heard))
        await until(lambda: "definition of /in" in ours.now)
        assert "what arrives is dropped or misread" in ours.now["definition of /in"]
