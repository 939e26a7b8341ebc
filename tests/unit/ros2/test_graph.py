"""The graph from tokens, the messages about its problems, and who is told that it has changed."""

import re
import time
from collections.abc import Iterable
from dataclasses import replace

import pytest

from pointit.bridges.ros2.graph.backend import (
    LATCHED,
    SENSOR,
    BackendHandle,
    Endpoint,
    EndpointKind,
    Graph,
    Qos,
    RosType,
)
from pointit.bridges.ros2.graph.findings import COUNTERPART, GraphFinding, Matching, findings
from pointit.bridges.ros2.graph.node_backend import BackendWarnings, GraphMonitor
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import MAX_TOKENS, LivelinessDirectory, Seen
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from tests.support.bench import ManualClock

POSE = RosType(name="geometry_msgs/msg/PoseStamped", hash="RIHS01_" + "a" * 64)
OTHER = replace(POSE, hash="RIHS01_" + "b" * 64)
HUMBLE = replace(POSE, hash="TypeHashNotSupported")
BOOL = RosType(name="std_msgs/msg/Bool", hash="RIHS01_" + "c" * 64)
KINDS = tuple(COUNTERPART)


def end(
    kind: EndpointKind = "subscriber", node: str = "/pointit", of: RosType = POSE, **more: object
) -> Endpoint:
    values: dict[str, object] = {"name": "/x", "qos": Qos(), "domain": 7, "is_ours": node == "/pointit"}
    return Endpoint(kind=kind, node=node, type=of, **(values | more))  # pyrefly: ignore[bad-argument-type]


def found(
    *endpoints: Endpoint, distro: str = "jazzy", matching: Matching = "definition"
) -> dict[str, GraphFinding]:
    graph = Graph(nodes=frozenset(), endpoints=frozenset(endpoints))
    result = findings(graph, domain=7, distro=distro, needs="they need this", matching=matching)
    assert len({each.about: each for each in result}) == len(result)
    assert all(len(each.sentence) < 600 for each in result)
    return {each.about: each for each in result}


@pytest.mark.parametrize("kind", KINDS)
def test_matching_endpoints_give_no_findings(kind: EndpointKind) -> None:
    other = COUNTERPART[kind]
    assert found(end(kind), end(other, "/robot")) == {}
    assert found(end(kind), end(other, "/robot", replace(POSE, hash=""))) == {}, "unknown, it fits every one"
    humble = (end(kind, of=HUMBLE), end(other, "/robot", HUMBLE))
    assert found(*humble, distro="humble") == {}
    assert found(end("server", qos=SENSOR), end("client", "/robot", qos=LATCHED)) == {}, "services have none"


@pytest.mark.parametrize("kind", KINDS)
def test_another_definition_is_named_with_both_hashes_and_the_remedy(kind: EndpointKind) -> None:
    about, finding = next(iter(found(end(kind), end(COUNTERPART[kind], "/robot", OTHER)).items()))
    assert about == "definition of /x"
    assert finding.sentence == (
        "ROS node /robot uses a different definition of geometry_msgs/msg/PoseStamped: on /x expected "
        "RIHS01_aaaaaaaaaaaaa…, saw RIHS01_bbbbbbbbbbbbb…, and nothing arrives; rebuild geometry_msgs there "
        "from PointIt's folder interfaces, or from a distribution whose definition is the same"
    )
    assert not finding.is_note


@pytest.mark.parametrize(
    ("ours", "theirs", "distro", "says"),
    [
        (POSE, HUMBLE, "jazzy", "is of Humble, .*; set distro to humble, or let them run jazzy"),
        (HUMBLE, POSE, "humble", r"is not of Humble, .* set distro to theirs \(jazzy"),
    ],
)
def test_humble_and_the_rest_never_meet(ours: RosType, theirs: RosType, distro: str, says: str) -> None:
    result = found(end(of=ours), end("publisher", "/robot", theirs), distro=distro)
    assert set(result) == {"distro"}, "said once, not for every topic"
    assert re.match(f"ROS node /robot {says}", result["distro"].sentence)


RELIABLE = Qos()


@pytest.mark.parametrize(
    ("writer", "reader", "says"),
    [
        (RELIABLE, RELIABLE, ""),
        (RELIABLE, SENSOR, ""),
        (LATCHED, RELIABLE, ""),
        (LATCHED, SENSOR, ""),
        (SENSOR, RELIABLE, "wants it reliable"),
        (RELIABLE, LATCHED, "wants earlier messages"),
        (SENSOR, LATCHED, "wants it reliable"),
        (None, LATCHED, ""),
    ],
)
def test_qos_that_dds_would_not_match_is_reported(writer: Qos | None, reader: Qos | None, says: str) -> None:
    sides: tuple[EndpointKind, ...] = ("publisher", "subscriber")
    for here in sides:
        mine, theirs = (writer, reader) if here == "publisher" else (reader, writer)
        result = found(end(here, qos=mine), end(COUNTERPART[here], "/robot", qos=theirs))
        assert set(result) == ({"QoS of /x"} if says else set())
        if says:
            assert says in result["QoS of /x"].sentence
            assert ("which is ours" in result["QoS of /x"].sentence) == (here == "subscriber")


def test_everybody_is_in_another_domain() -> None:
    result = found(end(), end("publisher", "/robot", domain=0), end("publisher", "/robot2", BOOL, domain=3))
    assert result["domain"].sentence == (
        "ROS nodes /robot, /robot2 are in domain 0, 3, we are in 7: nothing arrives; set domain_id to 0, or "
        "start them with ROS_DOMAIN_ID=7"
    )


def test_counterpart_in_another_domain_is_reported() -> None:
    here = end("publisher", "/near", name="/y")
    assert "domain" in found(end(), here, end("publisher", "/robot", domain=0))
    assert "domain" not in found(end(), here, end("publisher", "/robot", domain=0, name="/z"))
    assert "domain" not in found(end(), here, end("publisher", "/robot", domain=0), end("publisher", "/near"))


def test_another_pointit_is_named_and_its_domain_never_advised() -> None:
    bridge = end("publisher", "/other/pointit", is_bridge=True)
    assert found(end(), bridge)["bridge"].sentence == (
        "another PointIt bridge is node /other/pointit in this domain (7): we do not listen to it, but ROS "
        "nodes take the people and objects of both for the same; give one of the two another "
        "backend.domain_id and backend.node"
    )
    assert found(end(), replace(bridge, node="/pointit"))["bridge"], "whatever it is called"
    assert set(found(end(), replace(bridge, domain=0))) == {"nobody"}
    robot = end("publisher", "/robot", domain=3)
    assert "set domain_id to 3" in found(end(), replace(bridge, domain=0), robot)["domain"].sentence


def test_absence_of_other_nodes_is_a_note() -> None:
    assert found(end()) == {
        "nobody": GraphFinding(
            about="nobody", is_note=True, sentence="no other ROS node is seen in domain 7: they need this"
        )
    }
    assert found(end("publisher"), end("publisher", "/robot", name="/y")) == {}


def test_long_names_and_many_nodes_are_cut() -> None:
    crowd = [end("publisher", f"/robot{index:02}" + "x" * 200, OTHER) for index in range(30)]
    sentence = found(end(), *crowd)["definition of /x"].sentence
    assert "and 27 more use a different definition" in sentence
    assert "x" * 100 not in sentence


@pytest.mark.parametrize(
    ("of", "matching", "says"),
    [
        (OTHER, "definition", "and nothing arrives"),
        (OTHER, "type", "and what arrives is dropped or misread"),
        (BOOL, "definition", "uses /x as std_msgs/msg/Bool, we as geometry_msgs/msg/PoseStamped: nothing"),
        (BOOL, "type", "nothing arrives"),
    ],
)
def test_definition_finding_states_whether_messages_arrive(
    of: RosType, matching: Matching, says: str
) -> None:
    result = found(end(qos=LATCHED), end("publisher", "/robot", of, qos=SENSOR), matching=matching)
    about = "definition of /x" if of == OTHER else "type of /x"
    assert says in result[about].sentence
    arrives = "nothing" not in says
    assert ("QoS of /x" in result) == arrives, "where nothing arrives anyhow, that is nothing to speak of"


def rostered(tokens: Iterable[str]) -> tuple[LivelinessDirectory, list[int]]:
    changes: list[int] = []

    def read(token: str) -> Seen:
        name, _, domain = token.partition("@")
        return Seen(node=name, domain=int(domain), endpoint=end("publisher", name) if "end" in name else None)

    roster = LivelinessDirectory(read, 7, lambda: changes.append(1))
    roster.change(dict.fromkeys(tokens, True))
    return roster, changes


def test_directory_follows_tokens() -> None:
    roster, changes = rostered(["/a@7", "/b@0", "/end@7", "nonsense"])
    assert roster.graph() == Graph(
        nodes=frozenset({"/a", "/end"}), endpoints=frozenset({end("publisher", "/end")})
    )
    roster.change({"/a@7": True, "/unknown@7": False})
    assert len(changes) == 1
    roster.change({"/a@7": False, "nonsense": False, "/end@7": False})
    assert len(changes) == 2
    assert roster.graph() == Graph(nodes=frozenset(), endpoints=frozenset())


def test_own_tokens_stay_when_others_report_their_end() -> None:
    roster, changes = rostered([])
    roster.announce("/a@7")
    roster.change({"/a@7": True})
    roster.change({"/a@7": False})
    assert roster.graph().nodes == {"/a"}
    roster.retract("/a@7")
    assert roster.graph().nodes == frozenset()
    assert len(changes) == 2


def test_directory_is_bounded() -> None:
    roster, _ = rostered(f"/n{index}@7" for index in range(MAX_TOKENS + 9))
    assert len(roster.graph().nodes) == MAX_TOKENS


def test_a_crowd_is_looked_through_once() -> None:
    ours = [end("publisher", name=f"/user{count}/ray") for count in range(1000)]
    crowd = [end("publisher", "/robot", name=f"/robot/{count}") for count in range(8000)]
    began_s = time.thread_time()
    assert found(*ours, *crowd) == {}
    assert time.thread_time() - began_s < 1.5, "for each of ours it takes 4 s"


def outlook() -> GraphMonitor:
    bus = ServiceBus(MemoryBus(LocalBroker()), ManualClock(), "ros2", "ros2")
    return GraphMonitor(BackendWarnings(bus), domain=0, distro="jazzy", needs="", matching="type")


def with_node(node: str) -> Graph:
    return Graph(nodes=frozenset({node}), endpoints=frozenset())


async def test_watcher_gets_the_graph_and_changes_until_closed() -> None:
    made = outlook()
    seen = list[Graph]()
    watch = made.watch(seen.append)
    made.show(with_node("/a"), {})
    made.show(with_node("/a"), {})
    watch.close()
    watch.close()
    made.show(with_node("/b"), {})
    assert [each.nodes for each in seen] == [frozenset(), {"/a"}]


async def test_failing_or_closing_watcher_does_not_block_others() -> None:
    made = outlook()
    seen = list[Graph]()
    closed = list[Graph]()
    ends: list[BackendHandle] = []

    def failing(graph: Graph) -> None:
        if graph.nodes:
            ends[0].close()
            raise RuntimeError("a fault of theirs")

    made.watch(failing)
    ends.append(made.watch(closed.append))
    made.watch(seen.append)
    made.show(with_node("/a"), {})
    assert [each.nodes for each in seen] == [frozenset(), {"/a"}]
    assert [each.nodes for each in closed] == [frozenset()]


async def test_a_handler_that_fails_at_once_does_not_watch() -> None:
    made = outlook()
    told = list[Graph]()

    def failing(graph: Graph) -> None:
        told.append(graph)
        raise RuntimeError("a fault of theirs")

    with pytest.raises(RuntimeError, match="a fault of theirs"):
        made.watch(failing)
    made.show(with_node("/a"), {})
    assert len(told) == 1
