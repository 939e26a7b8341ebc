"""Services between two nodes of ours: many at once, none there, slow ones, failing ones, ends that close."""

import asyncio
import signal
import subprocess
import sys
import threading
import time

import pytest

from pointit.runtime.errors import BusClosedError, RefusedError
from tests.integration.ros2.nodes import ADD, BOOL, Graphs, Node, cdr_of, never, number_of
from tests.support.bench import until
from tests.support.pace import slowness, within


async def add(request: bytes) -> bytes:
    return cdr_of(number_of(request) + 1)


@pytest.mark.parametrize("modes", [("client", "peer"), ("router", "client")], ids="-".join)
async def test_every_call_gets_its_own_answer(at: Graphs, modes: tuple[str, str]) -> None:
    if "router" not in modes:
        await at.node("/router", "router")
    a, b = await at.node("/a", modes[0]), await at.node("/b", modes[1])
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


async def test_nobody_a_wrong_hash_and_a_slow_one_are_deadlines(a: Node, b: Node) -> None:
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

    async def garbage(_request: bytes) -> bytes:
        return b"garbage"

    async def refuse(_request: bytes) -> bytes:
        raise RefusedError("a speed of nan m/s was asked for")

    a.backend.serve("/refuse", ADD, refuse)
    with pytest.raises(TimeoutError, match=r"ROS service /refuse: a speed of nan m/s was asked for$"):
        await b.backend.call("/refuse", ADD, cdr_of(1), timeout_s=30)
    assert not caplog.records
    a.backend.serve("/fail", ADD, fail)
    a.backend.serve("/garbage", ADD, garbage)
    for service, why in (("/fail", "RuntimeError: oh no"), ("/garbage", "CDR begins with")):
        with pytest.raises(TimeoutError, match=why):
            await b.backend.call(service, ADD, cdr_of(1), timeout_s=30)
    assert len([record for record in caplog.records if "could not be answered" in record.message]) == 2


async def test_too_many_requests_at_once_are_refused_and_the_rest_answered(a: Node, b: Node) -> None:
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
    waiting = asyncio.create_task(b.backend.call("/none", ADD, cdr_of(1), timeout_s=120))
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
        await waiting
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


async def test_who_asks_and_does_not_read_holds_up_nobody_else(at: Graphs) -> None:
    a, b = await at.node("/a", "router"), await at.node("/b", "client")
    gate, asked = asyncio.Event(), 0

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
