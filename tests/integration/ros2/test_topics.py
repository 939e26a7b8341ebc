"""Topics of ROS, and other nodes beside ours."""

import gc
import time
from typing import Any, cast

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.bridges.ros2.graph.backend import LATCHED, ROSOUT, SENSOR, Qos
from pointit.bridges.ros2.graph.node_backend import MIN_CAPACITY
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.outbox import Outbox
from pointit.bridges.ros2.routing.routes import routes
from pointit.bridges.ros2.routing.site import RosSite
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import BusClosedError
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
    number_of,
)
from tests.support.bench import START_NS, ManualClock, until

MODES = [("peer", "client"), ("client", "client"), ("router", "peer")]


@pytest.mark.parametrize("modes", MODES, ids="-".join)
async def test_messages_arrive_once_in_order_both_ways(at: Graphs, modes: tuple[str, str]) -> None:
    if "router" not in modes:
        await at.node("/router", "router")
    a = await at.node("/a", modes[0])
    b = await at.node("/b", modes[1])
    names = [f"/user{index}/pointing_ray" for index in range(10)]
    to_b = [b.hears(name, POSE, SENSOR if index % 2 else RELIABLE) for index, name in enumerate(names)]
    to_a = a.hears("/tf", BOOL)
    writers = [
        a.backend.advertise(name, POSE, SENSOR if index % 2 else RELIABLE) for index, name in enumerate(names)
    ]
    back = b.backend.advertise("/tf", BOOL, RELIABLE)
    await met(a, b)
    for writer, seen in (*zip(writers, to_b, strict=True), (back, to_a)):
        await arrives(lambda writer=writer: writer.put(cdr_of(0)), seen)
    for number in range(1, 101):
        for writer in (*writers, back):
            writer.put(cdr_of(number))
        if number % 20 == 0:
            await until(lambda: {seen[-1] for seen in (*to_b, to_a)} == {number})  # noqa: B023

    for seen in (*to_b, to_a):
        assert [each for each in seen if each] == list(range(1, 101))
    assert not a.shown.ever
    assert not b.shown.ever


@pytest.mark.parametrize("modes", [("client", "peer"), ("router", "client")], ids="-".join)
async def test_late_subscriber_gets_latched_messages_once(at: Graphs, modes: tuple[str, str]) -> None:
    if "router" not in modes:
        await at.node("/router", "router")
    a = await at.node("/a", modes[0])
    first = a.backend.advertise("/state", BOOL, LATCHED)
    deep = a.backend.advertise("/static", BOOL, Qos(depth=3, latched=True))
    lossy = a.backend.advertise("/lossy", BOOL, Qos(depth=1, latched=True, reliable=False))
    for number in range(1, 6):
        for writer in (first, deep, lossy):
            writer.put(cdr_of(number))
    b = await at.node("/b", modes[1])
    state = b.hears("/state", BOOL, LATCHED)
    static = b.hears("/static", BOOL, Qos(depth=9, latched=True))
    unsure = b.hears("/lossy", BOOL, Qos(depth=1, latched=True, reliable=False))

    await until(lambda: (state, static, unsure) == ([5], [3, 4, 5], [5]), what=f"{state} {static} {unsure}")
    early = b.hears("/later", BOOL, LATCHED)
    await met(a, b)
    later = a.backend.advertise("/later", BOOL, LATCHED)
    later.put(cdr_of(8))
    await until(lambda: early == [8])

    first.put(cdr_of(6))
    later.put(cdr_of(9))
    await until(lambda: (state, early) == ([5, 6], [8, 9]))


async def test_late_subscriber_gets_no_old_messages_with_a_lifespan(at: Graphs, a: Node) -> None:
    log = a.backend.advertise("/rosout", POSE, ROSOUT)
    state = a.backend.advertise("/state", BOOL, LATCHED)
    for writer in (log, state):
        writer.put(cdr_of(1))
    b = await at.node("/b")
    latched = b.hears("/rosout", POSE, ROSOUT)
    plain = b.hears("/rosout", POSE, Qos(depth=1000))
    kept = b.hears("/state", BOOL, LATCHED)
    await until(lambda: kept == [1], what="what is kept to have been asked for")
    for seen in (latched, plain):
        await arrives(lambda: log.put(cdr_of(2)), seen)
    log.put(cdr_of(3))
    await until(lambda: latched[-1] == plain[-1] == 3)
    assert set(latched) == set(plain) == {2, 3}

    def is_latched_to(node: Node) -> bool:
        ends = {(end.kind, end.name, end.qos and end.qos.latched) for end in node.graph.endpoints}
        return ("publisher", "/rosout", True) in ends

    await until(lambda: is_latched_to(a) and is_latched_to(b), what="it to be called latched all the same")
    assert not a.shown.ever
    assert not b.shown.ever


async def test_own_messages_never_return(a: Node, b: Node) -> None:
    own = a.hears("/both", POSE)
    other = b.hears("/both", POSE)
    kept = a.hears("/state", BOOL, LATCHED)
    kept_there = b.hears("/state", BOOL, LATCHED)
    writer = a.backend.advertise("/both", POSE, RELIABLE)
    state = a.backend.advertise("/state", BOOL, LATCHED)
    await arrives(lambda: writer.put(cdr_of(1)), other)
    state.put(cdr_of(2))
    await until(lambda: kept_there == [2])
    back = b.backend.advertise("/both", POSE, RELIABLE)
    await arrives(lambda: back.put(cdr_of(3)), own)
    assert set(own) == {3}
    assert kept == []


async def test_own_messages_sent_back_by_others_are_dropped(a: Node, stranger: zenoh.Session) -> None:
    samples: list[zenoh.Sample] = []
    take = Callback(samples.append, indirect=False)
    subscriber = stranger.declare_subscriber(key_of("/both"), take, allowed_origin=zenoh.Locality.REMOTE)
    seen = a.hears("/both", POSE)
    writer = a.backend.advertise("/both", POSE, RELIABLE)
    await arrives(lambda: writer.put(cdr_of(1)), samples)
    attached = [each.attachment.to_bytes() for each in tuple(samples) if each.attachment is not None]
    for data in attached:
        stranger.put(key_of("/both"), cdr_of(1), attachment=data)
    foreign = attached[0][:-1] + bytes([attached[0][-1] ^ 1])
    stranger.put(key_of("/both"), cdr_of(9), attachment=foreign)
    await until(lambda: bool(seen))
    assert seen == [9]
    subscriber.undeclare()


async def test_repeated_message_is_processed_once(a: Node, stranger: zenoh.Session) -> None:
    seen = a.hears("/x", POSE)
    for number in (1, 1, 2, 1, 2, 3):
        stranger.put(key_of("/x"), cdr_of(number), attachment=attachment(number))
    stranger.put(key_of("/x"), cdr_of(4), attachment=attachment(3))  # one that never counts is no duplicate
    await until(lambda: seen[-1:] == [4])
    assert seen == [1, 2, 3, 4]


async def test_closed_endpoints_are_gone_and_others_continue(a: Node, b: Node) -> None:
    seen: list[int] = []
    reader = b.backend.subscribe("/x", POSE, RELIABLE, lambda cdr: seen.append(number_of(cdr)))
    rest = b.hears("/rest", POSE)
    writer = a.backend.advertise("/x", POSE, RELIABLE)
    other = a.backend.advertise("/rest", POSE, RELIABLE)
    state = a.backend.advertise("/state", BOOL, LATCHED)
    state.put(cdr_of(1))
    await arrives(lambda: writer.put(cdr_of(1)), seen)
    reader.close()
    reader.close()
    before = len(seen)
    state.close()
    writer.put(cdr_of(2))

    await arrives(lambda: other.put(cdr_of(2)), rest)
    assert len(seen) == before
    late = b.hears("/state", BOOL, LATCHED)
    there = {("publisher", "/x"), ("publisher", "/rest"), ("subscriber", "/rest"), ("subscriber", "/state")}
    await until(lambda: {(each.kind, each.name) for each in a.graph.endpoints} == there)
    assert late == []
    with pytest.raises(BusClosedError):
        state.put(cdr_of(3))

    await a.backend.close()
    await a.backend.close()
    with pytest.raises(BusClosedError):
        writer.put(cdr_of(3))
    with pytest.raises(BusClosedError):
        a.backend.advertise("/y", POSE, RELIABLE)


async def test_handles_that_nobody_refers_to_stay_declared(a: Node, b: Node) -> None:

    async def add(request: bytes) -> bytes:
        return request

    for end in "xy":
        a.backend.advertise(f"/put/{end}", POSE, RELIABLE)
        a.backend.subscribe(f"/hear/{end}", POSE, RELIABLE, lambda _cdr: None)
        a.backend.serve(f"/serve/{end}", BOOL, add)
    gc.collect()
    await until(lambda: len(b.graph.endpoints) == 6)
    seen = b.hears("/put/x", POSE)
    await until(lambda: any(each.node == "/b" for each in a.graph.endpoints))
    assert len(a.graph.endpoints) == 7
    assert not seen


async def test_busy_loop_drops_the_oldest_messages_and_reports_it(a: Node, b: Node) -> None:
    seen: list[int] = []
    reader: Any = b.backend.subscribe("/x", POSE, RELIABLE, lambda cdr: seen.append(number_of(cdr)))
    queue = reader._queue
    writer = a.backend.advertise("/x", POSE, RELIABLE)
    await arrives(lambda: writer.put(cdr_of(1)), seen)
    for number in range(2, 500):
        writer.put(cdr_of(number))
    until_s = time.monotonic() + 60.0
    while queue.overrun < 498 - MIN_CAPACITY and time.monotonic() < until_s:
        time.sleep(0.01)  # noqa: ASYNC251 - the loop is busy
    await until(lambda: seen[-1] == 499)
    assert len([number for number in seen if number > 1]) < 100
    assert "came faster than they could be handled" in b.shown.now["losses of /x"]


@pytest.mark.parametrize("name", ["/pointit", "/pointit2"])
async def test_bridges_in_one_domain_are_reported_and_ignore_each_other(at: Graphs, name: str) -> None:
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


def outbox_of(node: Node) -> Outbox:
    """Return the way out to ROS through `node`, as the service wires it."""
    clock = ManualClock()
    bus = ServiceBus(MemoryBus(LocalBroker()), clock, "ros2", "ros2")
    site = RosSite(bus=bus, clock=clock, backend=node.backend, state=ConversionState(Types("jazzy")))
    outbox = Outbox(routes().outward, site)
    node.backend.watch(outbox.look)
    return outbox


@pytest.mark.parametrize("mode", ["router", "peer", "client"])
async def test_a_subscriber_without_a_token_gets_live_data(at: Graphs, mode: str) -> None:
    if mode != "router":
        await at.node("/router", "router")
    outbox = outbox_of(await at.node("/pointit", mode))
    kind = Types("jazzy").kind("geometry_msgs/msg/PoseStamped")
    topic = cast("Any", RAY)
    samples = list[Any]()
    take = Callback(samples.append, indirect=False)
    subscriber = (await at.stranger()).declare_subscriber(key_of("/anna/pointing_ray", kind), take)
    ray = PointingRay(stamp_ns=START_NS, seq=1, origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0))
    await arrives(lambda: outbox.take(topic, ray, "anna"), samples)
    assert samples[0].attachment is not None
    subscriber.undeclare()
    outbox.close()
