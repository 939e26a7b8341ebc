"""The router, peers and the bridge in any order; and what they leave behind when they are killed."""

import asyncio
import signal
import socket
import sys
import time

import pytest

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import LATCHED
from pointit.bridges.ros2.graph.backends import opened
from pointit.runtime.errors import ConfigError, ConnectError, ListenError
from pointit.runtime.foreign_zenoh import RawLink, open_raw_session
from pointit.runtime.link.link import LEASE_MS, Link
from pointit.runtime.zenoh.session import own_sockets
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from tests.integration.ros2.nodes import (
    ADD,
    BOOL,
    POSE,
    RELIABLE,
    Graphs,
    Node,
    arrives,
    cdr_of,
    met,
    number_of,
    process,
)
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.pace import slowness
from tests.unit.ros2.graph_of_one import Shown

BACK_S = 15.0


async def echo(request: bytes) -> bytes:
    return request


async def test_what_listens_there_and_is_no_router_is_named(at: Graphs) -> None:
    run = await ZenohBus.open(Link(listen=(at.endpoint,)))
    try:
        a = await at.node("/a", "auto")
        await until(lambda: "router" in a.shown.now)
        told = f"who answers at {at.endpoint} is no router and passes nothing on; if it is a `pointit run`"
        assert a.shown.now["router"].startswith(told)
    finally:
        await run.close()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has the option")
async def test_who_is_cut_off_is_given_up_by_both_ends(at: Graphs) -> None:
    await at.node("/router", "router")
    await at.node("/a", "peer")

    def bounded() -> int:
        waits_ms = (each.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) for each in own_sockets())
        return sum(each == LEASE_MS for each in waits_ms)

    await until(lambda: bounded() >= 3, what="one that listens, both ends of a connection")


async def test_a_peer_opens_without_a_router_says_so_joins_and_survives_restarts(at: Graphs) -> None:
    began_s = time.monotonic()
    a, b = await asyncio.gather(at.node("/a"), at.node("/b"))
    assert time.monotonic() - began_s < 5 * slowness(), "0.5 s where the machine has time"
    seen, kept = b.hears("/x", POSE), b.hears("/state", BOOL, LATCHED)
    writer, state = (a.backend.advertise("/x", POSE, RELIABLE), a.backend.advertise("/state", BOOL, LATCHED))
    a.backend.serve("/echo", ADD, echo)
    state.put(cdr_of(1))
    for node in (a, b):
        await until(lambda node=node: "router" in node.shown.now)
        assert (
            node.shown.now["router"]
            == node.backend.problem
            == (
                f"no router answers at {at.endpoint}, trying again until one does: start one with "
                "`ros2 run rmw_zenoh_cpp rmw_zenohd`, or set mode to router to be it"
            )
        )
    writer.put(cdr_of(1))
    async with process("router", at.endpoint) as router:
        for turn in (1, 2):
            await until(lambda: not a.shown.now and not b.shown.now, BACK_S, "the router to be there")
            await met(a, b)
            await arrives(lambda turn=turn: writer.put(cdr_of(8 + turn)), seen, number=8 + turn)
            await until(lambda turn=turn: kept == list(range(1, turn + 1)))
            late = b.hears("/state", BOOL, LATCHED)
            await until(lambda turn=turn, late=late: late == [turn])
            assert number_of(await b.backend.call("/echo", ADD, cdr_of(5), timeout_s=60)) == 5
            if turn == 1:
                router.kill()
                await until(
                    lambda: "is lost" in a.backend.problem and "is lost" in b.shown.now.get("router", "")
                )
                await router.start()
                await until(lambda: not a.backend.problem and not b.backend.problem, BACK_S)
                state.put(cdr_of(2))
    assert kept == [1, 2]


async def test_clients_are_tried_again_and_survive_a_restart(at: Graphs) -> None:
    shown = Shown()
    config = BackendConfig(mode="client", endpoint=at.endpoint)
    waiting = asyncio.create_task(opened(config, shown))
    opening = asyncio.create_task(at.node("/a", "client"))
    await until(lambda: "router" in shown.now)
    said = f"nobody answers at {at.endpoint}: start one with `ros2 run rmw_zenoh_cpp rmw_zenohd`, or set"
    assert shown.now["router"].startswith(said)
    async with process("router", at.endpoint) as router:
        await (await waiting).close()
        assert not shown.now
        a, b = await opening, await at.node("/b", "client")
        seen, kept = b.hears("/x", POSE), b.hears("/state", BOOL, LATCHED)
        writer, state = (
            a.backend.advertise("/x", POSE, RELIABLE),
            a.backend.advertise("/state", BOOL, LATCHED),
        )
        state.put(cdr_of(1))
        await met(a, b)
        await until(lambda: kept == [1])
        router.kill()
        await until(lambda: "is lost" in a.backend.problem and "router" in b.shown.now)
        await until(lambda: b.graph.nodes == frozenset({"/b"}))
        state.put(cdr_of(2))
        await router.start()
        await until(lambda: not a.backend.problem and not b.shown.now, BACK_S)
        await met(a, b)
        await arrives(lambda: writer.put(cdr_of(9)), seen)
        await until(lambda: kept == [1, 2])


async def test_who_cannot_join_says_so_in_a_sentence_and_can_be_cancelled() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    client = BackendConfig(mode="client", endpoint=endpoint)
    with pytest.raises(ConnectError, match=r"nobody answers at tcp/127.0.0.1:\d+: start one with `ros2 run"):
        await opened(client, Shown(), patience_s=0.1)
    for mode in ("client", "peer"):
        opening = asyncio.create_task(opened(BackendConfig(mode=mode, endpoint=endpoint), Shown()))
        await asyncio.sleep(0.1)
        opening.cancel()
        began_s = time.monotonic()
        with pytest.raises(asyncio.CancelledError):
            await opening
        assert time.monotonic() - began_s < 5 * slowness()
    with pytest.raises(ConfigError, match="'7447' is no address; write one like tcp"):
        await open_raw_session(RawLink(endpoint="7447"))
    router = await opened(BackendConfig(mode="router", endpoint=endpoint), Shown())
    with pytest.raises(ListenError, match="a router is running there already: join it as a peer"):
        await opened(BackendConfig(mode="router", endpoint=endpoint), Shown())
    await router.close()


async def test_a_killed_node_is_gone_from_the_graph_and_its_calls_end(at: Graphs, a: Node) -> None:
    kept = a.hears("/kept", BOOL, LATCHED)
    async with process("talker", at.endpoint) as talker:
        await until(lambda: "/talker" in a.graph.nodes and kept == [1])
        call = asyncio.create_task(a.backend.call("/slow", ADD, cdr_of(1), timeout_s=120))
        await until(lambda: any(each.kind == "client" for each in a.graph.endpoints))
        done, _ = await asyncio.wait([call], timeout=0.3)
        assert not done
        talker.kill()
        with pytest.raises(TimeoutError, match="gone before it answered"):
            await call
        await until(lambda: a.graph.nodes == frozenset({"/a"}))
        assert {each.node for each in a.graph.endpoints} == {"/a"}
        await talker.start()
        await until(lambda: kept == [1, 1], what="another talker is another one")


async def test_a_reader_that_stands_still_does_not_stop_us(at: Graphs, a: Node, b: Node) -> None:
    seen = b.hears("/flood", POSE)
    async with process("talker", at.endpoint) as talker:
        await until(
            lambda: any(each.name == "/flood" and each.node == "/talker" for each in a.graph.endpoints)
        )
        writer = a.backend.advertise("/flood", POSE, RELIABLE)
        await arrives(lambda: writer.put(cdr_of(1)), seen)
        talker.send(signal.SIGSTOP)
        longest_s = 0.0
        for number in range(2, 2000):
            began_s = time.monotonic()
            writer.put(cdr_of(number, 20_000))
            longest_s = max(longest_s, time.monotonic() - began_s)
            if number % 10 == 0:
                await asyncio.sleep(0)
        assert longest_s < 4, "blocking would be 5 s"
        await arrives(lambda: writer.put(cdr_of(9999)), seen, number=9999)
        assert set(seen) <= {*range(1, 2000), 9999}
        talker.send(signal.SIGCONT)
