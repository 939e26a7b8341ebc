"""Connections that cost the server something and ask for nothing: who lets others in, and who is cut."""

import asyncio
import contextlib
import datetime as dt
import functools
import gc
import socket
import ssl
import tracemalloc
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from starlette.types import Receive, Scope, Send

from pointit.bridges.web.server import listener as serving
from pointit.bridges.web.server.bundle import PIECE, Pieces
from pointit.bridges.web.server.certificate import obtain
from pointit.bridges.web.server.listener import HttpListener, open_port
from pointit.runtime.errors import ListenError
from tests.support.bench import until

LONG = bytes(20 * 1024 * 1024)
ASKED = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"
LONG_ASKED = ASKED.replace(b"GET /", b"GET /long")
HALF_OPEN = [b"", b"GET / HTTP/1.1\r\nX: ", LONG_ASKED]

Contexts = tuple[ssl.SSLContext, ssl.SSLContext]


async def app(scope: Scope, receive: Receive, send: Send) -> None:
    await Pieces(LONG if scope["path"] == "/long" else b"hello")(scope, receive, send)


@asynccontextmanager
async def listening(tls: ssl.SSLContext | None = None, most: int = 0) -> AsyncGenerator[HttpListener]:
    listener = HttpListener(app, open_port("127.0.0.1", 0, "--port"), tls, max_connections=most)
    await listener.start()
    try:
        yield listener
    finally:
        await listener.close()


FLOODER = "127.0.0.2"
"""Another address of this machine than that of a browser."""


@pytest.mark.parametrize("address", ["127.0.0.1", FLOODER])
def test_listener_without_a_host_uses_all_addresses(address: str) -> None:
    with open_port("", 0, "--port") as bound:
        socket.create_connection((address, bound.getsockname()[1])).close()


async def test_client_before_the_start_is_answered_after_it() -> None:
    listener = HttpListener(app, open_port("127.0.0.1", 0, "--port"))
    try:
        early = await opened(listener, said=ASKED)
        await listener.start()
        answer = await asyncio.get_running_loop().sock_recv(early, 1024)
        early.close()
    finally:
        await listener.close()
    assert answer.startswith(b"HTTP/1.1 200")


def test_port_of_two_pages_is_refused_to_the_second() -> None:
    with open_port("127.0.0.1", 0, "--port") as first:
        port = first.getsockname()[1]
        with pytest.raises(ListenError, match=f"port {port} of 127.0.0.1 is not available"):
            open_port("127.0.0.1", port, "--port")


async def opened(listener: HttpListener, address: str = "127.0.0.1", said: bytes = b"") -> socket.socket:
    """Return a connection of `address` on which nothing more than `said` was said, and nothing is read."""
    client = socket.socket()
    client.setblocking(False)
    client.bind((address, 0))
    await asyncio.get_running_loop().sock_connect(client, ("127.0.0.1", listener.port))
    with contextlib.suppress(ConnectionError):  # it was cut already
        await asyncio.get_running_loop().sock_sendall(client, said)
    return client


@asynccontextmanager
async def flood(
    listener: HttpListener, count: int, address: str = FLOODER, said: bytes = b""
) -> AsyncGenerator[list[socket.socket]]:
    clients = [await opened(listener, address, said) for _ in range(count)]
    try:
        yield clients
    finally:
        for client in clients:
            client.close()


@asynccontextmanager
async def talking(
    listener: HttpListener, **options: Any
) -> AsyncGenerator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    where: dict[str, Any] = {} if "sock" in options else {"host": "127.0.0.1", "port": listener.port}
    reader, writer = await asyncio.open_connection(**where, **options)
    try:
        yield reader, writer
    finally:
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()


async def test_parts_of_a_response_wait_for_no_acknowledgement() -> None:
    async with listening() as listener, talking(listener) as (reader, writer):
        writer.write(ASKED)
        assert await reader.readline() == b"HTTP/1.1 200 OK\r\n"

        (connection,) = listener._state.connections
        accepted = connection.transport.get_extra_info("socket")
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) != 0


async def is_answered(listener: HttpListener) -> bool:
    """Return True if a well-behaved client has its response."""
    async with talking(listener) as (reader, writer), asyncio.timeout(60.0):
        writer.write(ASKED.replace(b"Host", b"Connection: close\r\nHost"))
        return b"hello" in await reader.read()


async def is_cut(client: socket.socket) -> bool:
    """Return True if the server ends the connection."""
    try:
        async with asyncio.timeout(60.0):
            return await asyncio.get_running_loop().sock_recv(client, 10) == b""
    except ConnectionError:
        return True
    except TimeoutError:
        return False


def has_ended(client: socket.socket) -> bool:
    """Return True if the server has ended the connection, on which it says nothing."""
    try:
        return client.recv(10) == b""
    except BlockingIOError:
        return False


async def test_silent_connections_block_no_browser() -> None:
    async with listening(most=8) as listener, flood(listener, 30, "127.0.0.1") as idle:
        assert await is_answered(listener)
        assert await is_cut(idle[0])
        assert not has_ended(idle[-1])


async def test_busy_connection_is_not_cut_for_newer_ones() -> None:
    async with listening(most=4) as listener, talking(listener, limit=PIECE) as (reader, writer):
        writer.write(LONG_ASKED)
        await reader.readline()
        async with flood(listener, 10, "127.0.0.1"):
            assert await is_answered(listener)
            header = await reader.readuntil(b"\r\n\r\n")
            assert b"content-length" in header.lower()
            assert len(await reader.readexactly(len(LONG))) == len(LONG)


@pytest.mark.parametrize("said", HALF_OPEN)
@pytest.mark.parametrize("address", [FLOODER, "127.0.0.1"])
async def test_half_open_connections_block_no_browser(address: str, said: bytes) -> None:
    async with listening(most=8) as listener, flood(listener, 40, address, said):
        for _ in range(5):
            assert await is_answered(listener)


async def test_silent_connections_take_few_places() -> None:
    async with listening() as listener, flood(listener, 3 * serving.MAX_ARRIVING) as silent:
        assert await is_answered(listener)
        assert listener.connections() <= serving.MAX_ARRIVING + 1
        assert await is_cut(silent[0])


async def test_resting_browser_is_not_cut_for_another_address() -> None:
    async with (
        listening(most=8) as listener,
        talking(listener) as (reader, writer),
        flood(listener, 40) as many,
    ):
        assert await is_cut(many[0])
        writer.write(ASKED)
        assert b"200" in await reader.readline()


def cuts_all(listener: HttpListener) -> bool:
    listener.cut_lingering()
    return listener.connections() == 0


@pytest.mark.parametrize("said", HALF_OPEN)
async def test_quiet_connection_is_cut(monkeypatch: pytest.MonkeyPatch, said: bytes) -> None:
    monkeypatch.setattr(serving, "CUT_PERIOD_S", 0.1)
    async with listening() as listener, flood(listener, 1, "127.0.0.1", said):
        await until(lambda: listener.connections() == 1)
        monkeypatch.setattr(serving, "QUIET_S", 0.2)
        await until(lambda: listener.connections() == 0, what="the quiet one to be cut")
        assert await is_answered(listener)


async def test_active_connection_is_not_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving, "CUT_PERIOD_S", 60.0)
    monkeypatch.setattr(serving, "QUIET_S", 0.0)  # a connection without a request since the last call is cut
    async with listening() as listener, talking(listener) as (reader, writer):
        for _ in range(10):
            writer.write(ASKED)
            assert b"200" in await reader.readline()
            await reader.readuntil(b"hello")
            listener.cut_lingering()
        await until(functools.partial(cuts_all, listener), what="who asks no more to be cut")


async def test_unread_response_uses_little_memory() -> None:
    async with listening() as listener, flood(listener, 5, "127.0.0.1") as clients:
        tracemalloc.start()
        try:
            gc.collect()
            before, _ = tracemalloc.get_traced_memory()
            for client in clients:
                await asyncio.get_running_loop().sock_sendall(client, LONG_ASKED)
            await until(lambda: listener.connections() == 5)
            await asyncio.sleep(0.3)
            after, _ = tracemalloc.get_traced_memory()
            assert after - before < 5 * 8 * PIECE
        finally:
            tracemalloc.stop()


@pytest.fixture
def secured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Contexts:
    """Return the contexts of a server and of its clients, few of whom may arrive at a time."""
    monkeypatch.setattr(serving, "MAX_ARRIVING", 4)
    kept = obtain(tmp_path, ["127.0.0.1"], "bench", dt.datetime.now(dt.UTC))
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(kept.certificate, kept.key)
    return tls, ssl.create_default_context(cafile=kept.certificate)


async def test_slow_handshake_is_not_cut_for_another_address(secured: Contexts) -> None:
    async with listening(secured[0]) as listener:
        phone = await opened(listener)
        async with flood(listener, 40) as many:
            assert await is_cut(many[0])
            secure = {"sock": phone, "ssl": secured[1], "server_hostname": "127.0.0.1"}
            async with talking(listener, **secure) as (reader, writer):
                writer.write(ASKED)
                assert b"200" in await reader.readline()
                await reader.readuntil(b"hello")


async def test_unfinished_tls_handshakes_block_no_browser(secured: Contexts) -> None:
    async with listening(secured[0]) as listener:
        silent = [socket.create_connection(("127.0.0.1", listener.port)) for _ in range(60)]  # all at once
        try:
            async with talking(listener, ssl=secured[1]) as (reader, writer), asyncio.timeout(60.0):
                writer.write(ASKED)
                assert b"200" in await reader.readline()
            for client in silent:
                client.setblocking(False)
            assert [await is_cut(client) for client in silent[:50]] == [True] * 50
        finally:
            for client in silent:
                client.close()
