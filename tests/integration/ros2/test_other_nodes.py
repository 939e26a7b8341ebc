"""Two bridges of PointIt at one ROS router; ROS nodes without a token in the graph."""

import itertools
from typing import Any, cast

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.bridges.ros2.graph.backend import SENSOR
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.outbox import Outbox
from pointit.bridges.ros2.routing.routes import routes
from pointit.bridges.ros2.routing.site import Site
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.schemas import PointingRay
from pointit.schemas.topics import RAY
from tests.integration.ros2.nodes import (
    BOOL,
    DOMAIN,
    POSE,
    RELIABLE,
    Graphs,
    Node,
    arrives,
    attachment,
    cdr_of,
    key_of,
    met,
)
from tests.support.bench import START_NS, ManualClock, until


@pytest.mark.parametrize("name", ["/pointit", "/pointit2"])
async def test_bridges_in_one_domain_are_named_and_do_not_hear_each_other(at: Graphs, name: str) -> None:
    a = await at.node("/pointit", "router", is_bridge=True)
    b = await at.node(name, is_bridge=True)
    robot = await at.node("/robot")
    to_a, to_b, to_robot = (each.hears("/user1/rotation", POSE) for each in (a, b, robot))
    writers = [each.backend.advertise("/user1/rotation", POSE, RELIABLE) for each in (a, b, robot)]
    await met(a, b, robot)
    for count, writer in enumerate(writers[:2]):
        await arrives(lambda count=count, writer=writer: writer.put(cdr_of(count)), to_robot, number=count)
    for seen in (to_a, to_b):
        await arrives(lambda: writers[2].put(cdr_of(2)), seen)
    assert set(to_a) == set(to_b) == {2}
    for node, other in ((a, name), (b, "/pointit")):
        told = f"another PointIt bridge is node {other} in this domain ({DOMAIN}): "
        await until(lambda node=node, told=told: node.shown.now.get("bridge", "").startswith(told))
    assert not robot.shown.ever
    await b.backend.close()
    await until(lambda: not a.shown.now)


async def test_a_bridge_in_another_domain_is_where_it_belongs(at: Graphs) -> None:
    a = await at.node("/pointit", "router", is_bridge=True)
    b = await at.node("/pointit", is_bridge=True, domain_id=0)
    robot = await at.node("/robot", domain_id=0)
    to_a, to_robot = a.hears("/x", BOOL), robot.hears("/x", BOOL)
    writer = b.backend.advertise("/x", BOOL, RELIABLE)
    await arrives(lambda: writer.put(cdr_of(1)), to_robot, 3)
    assert not [said for said in a.shown.ever if "/pointit" in said or "stray" in said]
    assert "stray /x" not in a.shown.now
    other = robot.backend.advertise("/x", BOOL, RELIABLE)

    def is_named() -> bool:
        other.put(cdr_of(2))
        return "stray /x" in a.shown.now

    await until(is_named, what="a plain node that is in another domain to be named")
    assert not to_a


def outbox_of(node: Node) -> Outbox:
    """Return the way out to ROS through `node`, as the service wires it."""
    clock = ManualClock()
    bus = ServiceBus(MemoryBus(LocalBroker()), clock, "ros2", "ros2")
    site = Site(bus=bus, clock=clock, backend=node.backend, state=ConversionState(Types("jazzy")))
    outbox = Outbox(routes().outward, site, unread=False)
    node.backend.watch(outbox.look)
    return outbox


@pytest.mark.parametrize("mode", ["router", "peer", "client"])
async def test_a_subscriber_without_a_token_gets_live_data(at: Graphs, mode: str) -> None:
    if mode != "router":
        await at.node("/router", "router")
    outbox = outbox_of(await at.node("/pointit", mode))
    kind, topic, samples = Types("jazzy").kind("geometry_msgs/msg/PoseStamped"), cast("Any", RAY), list[Any]()
    take = Callback(samples.append, indirect=False)
    subscriber = (await at.stranger()).declare_subscriber(key_of("/anna/pointing_ray", kind), take)
    ray = PointingRay(stamp_ns=START_NS, seq=1, origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0))
    await arrives(lambda: outbox.take(topic, ray, "anna"), samples)
    assert samples[0].attachment is not None
    subscriber.undeclare()
    outbox.close()


async def test_a_subscriber_without_a_token_is_reported_until_it_has_gone(at: Graphs) -> None:
    node = await at.node("/pointit", "router")
    writers = [node.backend.advertise(f"/user{index}/ray", POSE, SENSOR) for index in range(2)]
    take = Callback(list[zenoh.Sample]().append, indirect=False)
    subscriber = (await at.stranger()).declare_subscriber(key_of("/user0/ray"), take)
    await until(lambda: "unseen" in node.shown.now)
    assert "/user0/ray is read by" in node.shown.now["unseen"]
    assert "/user1/ray" not in node.shown.now["unseen"]
    assert not any("no other ROS node" in note for note in node.backend.notes)
    subscriber.undeclare()
    await until(lambda: "unseen" not in node.shown.now)
    assert writers


async def test_a_publisher_without_a_token_is_heard_and_reported(at: Graphs) -> None:
    node = await at.node("/pointit", "router")
    seen, old_node, counts = node.hears("/user1/imu_in", POSE), await at.stranger(), itertools.count(1)

    def put_and_look() -> bool:
        count = next(counts)
        old_node.put(key_of("/user1/imu_in"), cdr_of(count), attachment=attachment(count))
        return "unseen" in node.shown.now

    await until(put_and_look, what="a publisher that no token names to be reported")
    assert seen
    assert "/user1/imu_in is written by" in node.shown.now["unseen"]
    await until(lambda: "unseen" not in node.shown.now)


async def test_nodes_with_tokens_are_not_reported(at: Graphs) -> None:
    node, robot = await at.node("/pointit", "router"), await at.node("/robot")
    writer = node.backend.advertise("/ray", POSE, SENSOR)
    back = robot.backend.advertise("/back", POSE, SENSOR)
    to_robot, to_node = robot.hears("/ray", POSE, SENSOR), node.hears("/back", POSE, SENSOR)

    async def both_ways(count: int) -> None:
        await arrives(lambda: writer.put(cdr_of(len(to_robot))), to_robot, count)
        await arrives(lambda: back.put(cdr_of(len(to_node))), to_node, count)
        node.backend._look()

    await both_ways(1)  # a node of another domain is named as long as there is none of this one
    elsewhere = await at.node("/elsewhere", domain_id=DOMAIN + 1)
    elsewhere.hears("/ray", POSE, SENSOR)
    for count in range(2, 5):
        await both_ways(count)
    assert not node.backend._directory.graph().unseen
    assert not node.shown.ever
