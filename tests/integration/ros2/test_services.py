"""Services of ROS, and its routers."""

import asyncio
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import LATCHED
from pointit.bridges.ros2.graph.backends import opened
from pointit.runtime.errors import BusClosedError, ConfigError, ConnectError, ListenError, RefusedError
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
    never,
    number_of,
    process,
)
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.pace import slowness, within
from tests.unit.ros2.graph_of_one import Shown


async def add(request: bytes) -> bytes:
    return cdr_of(number_of(request) + 1)


@pytest.mark.parametrize("modes", [("client", "peer"), ("router", "client")], ids="-".join)
async def test_every_call_gets_its_own_answer(at: Graphs, modes: tuple[str, str]) -> None:
    if "router" not in modes:
        await at.node("/router", "router")
    a = await at.node("/a", modes[0])
    b = await at.node("/b", modes[1])
    a.backend.serve("/add_pack", ADD, add)
    b.backend.serve("/add_back", ADD, add)

    async def ask(number: int) -> int:
        node, service = ((b, "/add_pack"), (a, "/add_back"))[number % 2]
        return number_of(await node.backend.call(service, ADD, cdr_of(number), timeout_s=60))

    assert await asyncio.gather(*map(ask, range(40))) == list(range(1, 41))
    kinds = {(each.kind, each.name) for each in a.graph.endpoints}
    await until(lambda: {(each.kind, each.name) for each in b.graph.endpoints} >= kinds)
    assert not a.shown.ever


async def test_a_server_that_comes_while_a_call_waits_is_asked(a: Node, b: Node) -> None:
    call = asyncio.create_task(b.backend.call("/add_pack", ADD, cdr_of(1), timeout_s=60))
    await until(lambda: any(each.kind == "client" for each in a.graph.endpoints))
    done, _ = await asyncio.wait([call], timeout=0.5)
    assert not done, "it waits for a server, longer than it tries again"
    a.backend.serve("/add_pack", ADD, add)
    assert number_of(await call) == 2


async def test_call_times_out_without_server_with_wrong_hash_or_late(a: Node, b: Node) -> None:
    a.backend.serve("/slow", ADD, never)
    a.backend.serve("/other", BOOL, add)
    await until(lambda: {"/slow", "/other"} <= {each.name for each in b.graph.endpoints})
    for service, why in (("/none", "no node serves it"), ("/slow", "did not answer"), ("/other", "no node")):
        began_s = time.monotonic()
        with pytest.raises(TimeoutError, match=f"ROS service {service}: .*{why}.* within 0.3 s"):
            await b.backend.call(service, ADD, cdr_of(1), timeout_s=0.3)
        assert time.monotonic() - began_s < 5 * slowness()


async def test_a_failing_server_is_an_answer_at_once(
    a: Node, b: Node, caplog: pytest.LogCaptureFixture
) -> None:

    async def fail(_request: bytes) -> bytes:
        raise RuntimeError("oh no")

    async def refuse(_request: bytes) -> bytes:
        raise RefusedError("a speed of nan m/s was asked for")

    a.backend.serve("/refuse", ADD, refuse)
    with pytest.raises(TimeoutError, match=r"ROS service /refuse: a speed of nan m/s was asked for$"):
        await b.backend.call("/refuse", ADD, cdr_of(1), timeout_s=30)
    assert not caplog.records
    a.backend.serve("/fail", ADD, fail)
    with pytest.raises(TimeoutError, match="RuntimeError: oh no"):
        await b.backend.call("/fail", ADD, cdr_of(1), timeout_s=30)
    assert len([record for record in caplog.records if "could not be answered" in record.message]) == 1


async def test_excess_requests_are_refused_and_others_answered(a: Node, b: Node) -> None:
    gate = asyncio.Event()

    async def wait(request: bytes) -> bytes:
        await gate.wait()
        return request

    a.backend.serve("/wait", ADD, wait)
    calls = [
        asyncio.create_task(b.backend.call("/wait", ADD, cdr_of(number), timeout_s=60))
        for number in range(100)
    ]
    await until(lambda: sum(call.done() for call in calls) == 36, 10, "those beyond 64 to be refused")
    gate.set()
    results = await asyncio.gather(*calls, return_exceptions=True)
    assert len([each for each in results if isinstance(each, bytes)]) == 64
    assert all("busy" in str(each) for each in results if not isinstance(each, bytes))


async def test_closing_ends_what_waits(a: Node, b: Node) -> None:
    asked = asyncio.Event()

    async def slow(_request: bytes) -> bytes:
        asked.set()
        await asyncio.Event().wait()
        return b""

    desk = a.backend.serve("/slow", ADD, slow)
    answered = asyncio.create_task(b.backend.call("/slow", ADD, cdr_of(1), timeout_s=6))
    cancelled = asyncio.create_task(b.backend.call("/none", ADD, cdr_of(1), timeout_s=120))
    await asked.wait()
    cancelled.cancel()
    desk.close()
    with pytest.raises(TimeoutError, match="gone before it answered"):
        await answered
    with pytest.raises(asyncio.CancelledError):
        await cancelled
    await b.backend.close()
    with pytest.raises(BusClosedError):
        await b.backend.call("/none", ADD, cdr_of(1), timeout_s=120)


STUCK = """\
import json, struct, sys, time, zenoh
config = zenoh.Config()
for key, value in {"mode": "client", "connect/endpoints": [sys.argv[1]]}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
for number in range(40):
    origin = struct.pack("<qqB16s", number, 0, 16, b"g" * 16)
    session.get(sys.argv[2], lambda _: None, payload=bytes((0, 1, 0, 0, 1)), attachment=origin, timeout=60)
time.sleep(60)
"""
"""Asks, and is stopped before it is answered."""
LARGE = 900_000


def start(program: str, *arguments: str) -> "subprocess.Popen[bytes]":
    return subprocess.Popen([sys.executable, "-c", program, *arguments])


async def test_client_that_does_not_read_blocks_no_other(at: Graphs) -> None:
    a = await at.node("/a", "router")
    b = await at.node("/b", "client")
    gate = asyncio.Event()
    asked = 0

    async def serve(_request: bytes) -> bytes:
        nonlocal asked
        asked += 1
        await gate.wait()
        return cdr_of(0, LARGE)

    a.backend.serve("/large", ADD, serve)
    a.backend.serve("/add_pack", ADD, add)
    assert number_of(await b.backend.call("/add_pack", ADD, cdr_of(1), timeout_s=60)) == 2

    key = f"7/large/{ADD.dds_name}/{ADD.hash}"
    stuck = start(STUCK, at.endpoint, key)
    try:
        await until(lambda: asked == 40, 10)
        stuck.send_signal(signal.SIGSTOP)
        gate.set()
        await until(lambda: threading.active_count() > 20, what="answers that wait for the one who is stuck")
        began_s = time.monotonic()
        assert number_of(await b.backend.call("/add_pack", ADD, cdr_of(1), timeout_s=60)) == 2
        is_quick = within(time.monotonic() - began_s, 3.0)
        assert is_quick or threading.active_count() > 20, "the answers to the other take 4 s"
    finally:
        stuck.kill()
        stuck.wait(10)


BACK_S = 15.0


async def echo(request: bytes) -> bytes:
    return request


async def test_listener_that_is_no_router_is_reported(at: Graphs) -> None:
    run = await ZenohBus.open(Link(listen=(at.endpoint,)))
    try:
        a = await at.node("/a", "auto")
        await until(lambda: "router" in a.shown.now)
        told = f"who answers at {at.endpoint} is no router and passes nothing on; if it is a `pointit run`"
        assert a.shown.now["router"].startswith(told)
    finally:
        await run.close()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has the option")
async def test_cut_connection_is_ended_by_both_sides(at: Graphs) -> None:
    await at.node("/router", "router")
    await at.node("/a", "peer")

    def bounded() -> int:
        waits_ms = (each.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) for each in own_sockets())
        return sum(each == LEASE_MS for each in waits_ms)

    await until(lambda: bounded() >= 3, what="one that listens, both ends of a connection")


async def test_peer_waits_for_its_router_and_survives_restarts(at: Graphs) -> None:
    began_s = time.monotonic()
    a, b = await asyncio.gather(at.node("/a"), at.node("/b"))
    assert time.monotonic() - began_s < 5 * slowness(), "0.5 s where the machine has time"

    seen = b.hears("/x", POSE)
    kept = b.hears("/state", BOOL, LATCHED)
    writer = a.backend.advertise("/x", POSE, RELIABLE)
    state = a.backend.advertise("/state", BOOL, LATCHED)
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
        a = await opening
        b = await at.node("/b", "client")
        seen = b.hears("/x", POSE)
        kept = b.hears("/state", BOOL, LATCHED)
        writer = a.backend.advertise("/x", POSE, RELIABLE)
        state = a.backend.advertise("/state", BOOL, LATCHED)
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


async def test_failing_join_is_reported_and_can_be_cancelled() -> None:
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


async def test_killed_node_leaves_the_graph_and_its_calls_end(at: Graphs, a: Node) -> None:
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
