"""The ROS graph as it was seen last: who is told that it has changed."""

import pytest

from pointit.bridges.ros2.graph.backend import Closable, Graph
from pointit.bridges.ros2.graph.backend_warnings import BackendWarnings
from pointit.bridges.ros2.graph.graph_monitor import GraphMonitor
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from tests.support.bench import ManualClock


def outlook() -> GraphMonitor:
    bus = ServiceBus(MemoryBus(LocalBroker()), ManualClock(), "ros2", "ros2")
    return GraphMonitor(BackendWarnings(bus), domain=0, distro="jazzy", needs="", matching="type")


def graph(node: str) -> Graph:
    return Graph(nodes=frozenset({node}), endpoints=frozenset())


async def test_each_is_told_what_is_and_what_changes_until_they_close() -> None:
    made, seen = outlook(), list[Graph]()
    watch = made.watch(seen.append)
    made.show(graph("/a"), {})
    made.show(graph("/a"), {})
    watch.close()
    watch.close()
    made.show(graph("/b"), {})
    assert [each.nodes for each in seen] == [frozenset(), {"/a"}]


async def test_who_is_closed_by_another_is_not_told_any_more() -> None:
    made, seen = outlook(), list[Graph]()
    ends: list[Closable] = []

    def close_the_other(seen: Graph) -> None:
        if seen.nodes:
            ends[0].close()

    made.watch(close_the_other)
    ends.append(made.watch(seen.append))
    made.show(graph("/a"), {})
    assert [each.nodes for each in seen] == [frozenset()]


async def test_a_handler_that_fails_keeps_nobody_else_from_being_told() -> None:
    made, seen = outlook(), list[Graph]()

    def failing(seen: Graph) -> None:
        if seen.nodes:
            raise RuntimeError("a fault of theirs")

    made.watch(failing)
    made.watch(seen.append)
    made.show(graph("/a"), {})
    assert [each.nodes for each in seen] == [frozenset(), {"/a"}]


async def test_who_fails_at_once_does_not_watch() -> None:
    made, told = outlook(), list[Graph]()

    def once(seen: Graph) -> None:
        told.append(seen)
        raise RuntimeError("a fault of theirs")

    with pytest.raises(RuntimeError, match="a fault of theirs"):
        made.watch(once)
    made.show(graph("/a"), {})
    assert len(told) == 1
