"""Slow, many, hostile and vanished pages; an end while they are open; a server that comes back."""

import asyncio
import base64
import contextlib
import json
import os
import socket
from typing import Any

import psutil
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus

from pointit.bridges.web import service
from pointit.bridges.web.model import site_model
from pointit.bridges.web.pages import page_session
from pointit.bridges.web.pages.page_session import ASKS_BURST, MAX_MALFORMED
from pointit.bridges.web.server import listener
from pointit.bridges.web.server.paced_websocket import PacedWebSocket
from pointit.schemas import Cursor, StripsFrame
from pointit.schemas.environment import StripFrame
from pointit.schemas.topics import CURSOR, HEALTH, STRIPS_FRAME, UNDO_SELECTION
from tests.integration.web.pages import VIEWER, Page, Server, serving
from tests.support.bench import START_NS, Bench, memory_bench, until
from tests.support.pace import within


def light(bench: Bench, count: int) -> None:
    """Put a large frame that does not compress."""
    strips = tuple(StripFrame(id=f"s{k}", rgb=os.urandom(12_000)) for k in range(20))
    bench.put(STRIPS_FRAME, StripsFrame(stamp_ns=START_NS, seq=count, strips=strips))


async def raw_page(server: Server) -> socket.socket:
    """Open a websocket by hand whose client never reads."""
    loop = asyncio.get_running_loop()
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.setblocking(False)
    host, _, port = server.host.partition(":")
    await loop.sock_connect(client, (host, int(port)))
    lines = [
        "GET /ws HTTP/1.1",
        f"Host: {server.host}",
        f"Origin: {server.url}",
        f"Cookie: {await server.cookie()}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}",
    ]
    await loop.sock_sendall(client, ("\r\n".join(lines) + "\r\n\r\n").encode())
    return client


async def shows(page: Page, count: int) -> None:
    await until(lambda: page.states.get((STRIPS_FRAME.key, ""), {}).get("seq") == count)


@pytest.fixture
def tight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have what is sent to who reads nothing stay in the server, not in the system."""

    def open_narrow_port(host: str, port: int, option: str) -> socket.socket:
        bound = listener.open_port(host, port, option)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        return bound

    monkeypatch.setattr(service, "open_port", open_narrow_port)


@pytest.mark.usefixtures("tight")
async def test_page_that_reads_nothing_is_cut_and_costs_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listener, "PING_S", 0.5)
    async with memory_bench() as bench, serving(bench) as server:
        reports = bench.collect(HEALTH, "web")
        async with server.page() as page:
            stalled = await raw_page(server)
            try:
                await until(lambda: page.status.get("viewers") == 2)
                for count in range(5):
                    light(bench, count)
                    await shows(page, count)
                await until(lambda: page.status["viewers"] == 1, what="the stalled page to be cut")
            finally:
                stalled.close()
        assert reports[-1].errors == 0


@pytest.mark.slow
async def test_fifty_pages_are_served() -> None:
    leave = asyncio.Event()
    arrived: list[Page] = []

    async def look_on(server: Server) -> None:
        async with server.page() as page:
            await until(lambda: (CURSOR.key, "anna") in page.states, patience_s=20)
            arrived.append(page)
            await leave.wait()
            await until(lambda: page.states[CURSOR.key, "anna"]["seq"] == 7, patience_s=20)

    async with memory_bench() as bench, serving(bench) as server, asyncio.TaskGroup() as group:
        bench.put(CURSOR, Cursor(stamp_ns=START_NS), "anna")
        for _ in range(50):
            group.create_task(look_on(server))
        await until(lambda: len(arrived) == 50, patience_s=25)
        bench.put(CURSOR, Cursor(stamp_ns=START_NS, seq=7), "anna")
        leave.set()


async def test_viewers_share_a_budget_that_refused_requests_spend(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(page_session, "VIEWERS_HZ", 0.001)
    monkeypatch.setattr(page_session, "VIEWERS_BURST", 6.0)
    async with memory_bench() as bench, serving(bench) as server, contextlib.AsyncExitStack() as stack:
        viewers = [await stack.enter_async_context(server.page(VIEWER, hangs_up=True)) for _ in range(3)]
        operator = await stack.enter_async_context(server.page())
        for number in range(10):
            for page in viewers:
                await page.say(kind="ask", id=number, key="no/such")
        await until(lambda: sum(len(page.answers) for page in viewers) == 6)

        for number in range(10):
            await operator.say(kind="ask", id=number, key="no/such")
        await until(lambda: len(operator.answers) == 10)
        assert sum(len(page.answers) for page in viewers) == 6

        bench.put(CURSOR, Cursor(stamp_ns=START_NS), "anna")
        for page in viewers:
            await until(lambda page=page: (CURSOR.key, "anna") in page.states)


async def test_flood_of_a_viewer_is_not_parsed_beyond_the_allowance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_session, "VIEWERS_HZ", 0.001)
    monkeypatch.setattr(page_session, "VIEWERS_BURST", 3.0)
    parsed = 0
    parse = PacedWebSocket.send_receive_event_to_app

    def count_and_parse(protocol: PacedWebSocket) -> None:
        nonlocal parsed
        parsed += 1
        parse(protocol)

    async with memory_bench() as bench, serving(bench) as server, contextlib.AsyncExitStack() as stack:
        flooder = await stack.enter_async_context(server.page(VIEWER, hangs_up=True))
        operator = await stack.enter_async_context(server.page())
        monkeypatch.setattr(PacedWebSocket, "send_receive_event_to_app", count_and_parse)

        flood = json.dumps({"kind": "ask", "id": 1, "key": "no/such"})
        await send_many(flooder, [flood] * 5000)  # the system takes what the server does not read
        await until(lambda: bool(flooder.answers))
        for number in range(20):
            await operator.say(kind="ask", id=number, key="no/such")
            await until(lambda number=number: number in operator.answers)

        assert parsed < 200


async def send_many(page: Page, texts: list[str]) -> None:
    """Send without waiting for answers, until the page is closed."""
    with contextlib.suppress(ConnectionClosed):
        for text in texts:
            await page.socket.send(text)


async def test_repeated_acknowledgement_costs_and_closes_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_session, "VIEWERS_HZ", 0.001)
    monkeypatch.setattr(page_session, "VIEWERS_BURST", float(MAX_MALFORMED + 3))
    async with memory_bench() as bench, serving(bench) as server, contextlib.AsyncExitStack() as stack:
        viewer = await stack.enter_async_context(server.page(VIEWER))
        other = await stack.enter_async_context(server.page(VIEWER, hangs_up=True))
        await until(lambda: bool(viewer.batches))

        await send_many(viewer, [json.dumps({"kind": "ack", "n": 1})] * (2 * MAX_MALFORMED))

        await until(lambda: viewer.socket.close_code == 1008)
        for number in range(10):
            await other.say(kind="ask", id=number, key="no/such")
        await until(lambda: len(other.answers) == 3, what="what the acknowledgements left of the budget")
        bench.put(CURSOR, Cursor(stamp_ns=START_NS), "anna")
        await until(lambda: (CURSOR.key, "anna") in other.states)
        assert len(other.answers) == 3


async def test_status_is_diagnosed_once_for_all_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    diagnosed = 0
    diagnose = site_model.diagnose

    def count_and_diagnose(*arguments: Any) -> Any:
        nonlocal diagnosed
        diagnosed += 1
        return diagnose(*arguments)

    async with memory_bench() as bench, serving(bench) as server, contextlib.AsyncExitStack() as stack:
        pages = [await stack.enter_async_context(server.page(VIEWER)) for _ in range(5)]
        await until(lambda: all(page.status.get("viewers") == 5 for page in pages))
        statuses_before = [page.statuses for page in pages]
        monkeypatch.setattr(site_model, "diagnose", count_and_diagnose)

        def new_statuses() -> list[int]:
            return [page.statuses - before for page, before in zip(pages, statuses_before, strict=True)]

        await until(lambda: min(new_statuses()) >= 3)

        assert diagnosed <= max(new_statuses()) + 1, "the last one may be on its way"


async def test_viewers_that_open_too_many_pages_at_once_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(page_session, "VIEWERS_OPENED_HZ", 0.001)
    monkeypatch.setattr(page_session, "VIEWERS_OPENED_BURST", 2.0)
    async with memory_bench() as bench, serving(bench) as server:
        for _ in range(2):
            async with server.page(VIEWER):
                pass
        with pytest.raises(InvalidStatus) as refused:
            async with server.page(VIEWER):
                pass
        assert refused.value.response.status_code == 503
        async with server.page() as operator:
            assert operator.hello is not None


async def test_excess_requests_of_a_page_are_refused_and_reported(bench: Bench, page: Page) -> None:
    count = int(ASKS_BURST) + 20
    for number in range(count):
        await page.say(kind="ask", id=number, key="no/such")
    await until(lambda: len(page.answers) == count)
    errors = [answer["error"] for answer in page.answers.values()]
    assert sum("too many requests" in error for error in errors) >= 10
    assert sum("pages cannot ask" in error for error in errors) >= ASKS_BURST
    bench.put(CURSOR, Cursor(stamp_ns=START_NS), "anna")
    await until(lambda: (CURSOR.key, "anna") in page.states)


def connected(server: Server) -> int:
    port = int(server.host.rpartition(":")[2])
    connections = psutil.Process().net_connections(kind="tcp")
    return sum(each.status == psutil.CONN_ESTABLISHED and each.laddr.port == port for each in connections)


@pytest.mark.usefixtures("tight")
async def test_pages_are_closed_at_once_when_the_server_ends(bench: Bench) -> None:
    loop = asyncio.get_running_loop()
    async with serving(bench) as server:
        cookie = await server.cookie()
        sockets = [await server.connect(cookie) for _ in range(3)]
        stalled = await raw_page(server)
        for count in range(10):
            light(bench, count)
            await asyncio.sleep(0.01)

        await until(lambda: connected(server) >= 4, what="all to be connected")
        began_s = loop.time()
    assert within(loop.time() - began_s, 3.0)
    await until(lambda: connected(server) == 0, what="every connection to end, read or not")

    for page in sockets:
        with contextlib.suppress(ConnectionClosed):
            async for _ in page:
                pass
        assert page.close_code == 1012
    stalled.close()


async def test_malformed_messages_are_counted_and_then_close_the_page(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with memory_bench() as bench, serving(bench) as server:
        reports = bench.collect(HEALTH, "web")
        async with server.page() as page:
            await page.say(kind="nonsense")
            await until(lambda: any("malformed" in w for w in (reports[-1].warnings if reports else ())))
            for _ in range(MAX_MALFORMED - 1):
                await page.socket.send("{")
            await until(lambda: page.socket.close_code == 1008)
        async with server.page():
            pass
        assert not [record for record in caplog.records if record.exc_info]


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)

SAID = st.fixed_dictionaries(
    {"kind": st.sampled_from(["ack", "ask", "aim", "turn", "hello", ""])},
    optional={
        "n": JSON,
        "id": st.integers() | JSON,
        "latency_ms": JSON,
        "key": st.sampled_from([UNDO_SELECTION.key, "run/scenario"]) | JSON,
        "deed": st.sampled_from(["press", "take", "centre"]) | JSON,
        "name": st.just("anna") | JSON,
        "query": JSON,
        "user": st.just("anna") | JSON,
        "at_m": st.just([1, 2, 3]) | JSON,
        "q": JSON,
    },
).map(json.dumps)

ANYTHING = SAID | JSON.map(json.dumps) | st.text(max_size=100) | st.binary(max_size=100)


@given(st.lists(st.lists(ANYTHING, max_size=30), min_size=1, max_size=10))
@settings(max_examples=5, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_server_survives_any_page_message(
    caplog: pytest.LogCaptureFixture, sessions: list[list[str | bytes]]
) -> None:
    async def say() -> None:
        async with memory_bench() as bench, serving(bench) as server:
            reports = bench.collect(HEALTH, "web")
            cookie = await server.cookie()
            for messages in sessions:
                async with server.connect(cookie) as page:
                    with contextlib.suppress(ConnectionClosed):
                        for each in messages:
                            await page.send(each)
            async with server.page() as page:
                assert page.hello is not None
            await until(lambda: bool(reports))
            assert reports[-1].errors == 0

    asyncio.run(say())
    assert not [record for record in caplog.records if record.exc_info]


@given(st.lists(st.binary(max_size=200), max_size=10))
@settings(max_examples=5)
def test_server_survives_any_bytes(bytes_sent: list[bytes]) -> None:
    async def send() -> None:
        async with memory_bench() as bench, serving(bench) as server:
            host, _, port = server.host.partition(":")
            for payload in bytes_sent:
                _, writer = await asyncio.open_connection(host, int(port))
                writer.write(payload)
                writer.write_eof()
                writer.close()
            raw = await raw_page(server)
            await asyncio.get_running_loop().sock_sendall(raw, b"".join(bytes_sent))
            raw.close()
            async with server.client() as client:
                assert (await client.get("/static/app.js")).status_code == 200

    asyncio.run(send())
