"""Connections that cost the server something and ask for nothing: who lets others in, and who is cut."""

import asyncio
import contextlib
import datetime as dt
import gc
import socket
import ssl
import tracemalloc
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from starlette.types import Receive, Scope, Send

from pointit.bridges.web.server import listener as serving
from pointit.bridges.web.server.bundle import PIECE, Pieces
from pointit.bridges.web.server.certificate import obtain
from pointit.bridges.web.server.listener import Listener, bind
from tests.support.bench import until

LONG = bytes(20 * 1024 * 1024)
ASKED = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"


async def app(scope: Scope, receive: Receive, send: Send) -> None:
    await Pieces(LONG if scope["path"] == "/long" else b"hello")(scope, receive, send)


@asynccontextmanager
async def listening(tls: ssl.SSLContext | None = None, most: int = 0) -> AsyncGenerator[Listener]:
    listener = Listener(app, bind("127.0.0.1", 0, "--port"), tls, most=most)
    await listener.start()
    try:
        yield listener
    finally:
        await listener.close()


FLOODER = "127.0.0.2"
"""Another address of this machine than that of a browser."""


async def opened(listener: Listener, address: str = "127.0.0.1", said: bytes = b"") -> socket.socket:
    """Return a connection of `address` on which nothing more than `said` was said, and nothing is read."""
    client = socket.socket()
    client.setblocking(False)
    client.bind((address, 0))
    await asyncio.get_running_loop().sock_connect(client, ("127.0.0.1", listener.port))
    with contextlib.suppress(ConnectionError):  # it was cut already
        await asyncio.get_running_loop().sock_sendall(client, said)
    return client


async def answered(listener: Listener) -> bytes:
    """Return the response to a well-behaved client."""
    reader, writer = await asyncio.open_connection("127.0.0.1", listener.port)
    writer.write(ASKED.replace(b"Host", b"Connection: close\r\nHost"))
    try:
        async with asyncio.timeout(60.0):
            return await reader.read()
    finally:
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()


async def is_cut(client: socket.socket, within_s: float = 30.0) -> bool:
    """Return True if the server ends the connection within that time."""
    try:
        async with asyncio.timeout(within_s):
            return await asyncio.get_running_loop().sock_recv(client, 10) == b""
    except ConnectionError:
        return True
    except TimeoutError:
        return False


async def test_many_who_say_nothing_keep_nobody_out() -> None:
    async with listening(most=8) as listener:
        idle = [await opened(listener) for _ in range(30)]
        try:
            assert b"hello" in await answered(listener)
            assert await is_cut(idle[0])
            assert not await is_cut(idle[-1], 1.0)
        finally:
            for client in idle:
                client.close()


async def test_who_is_answered_is_not_cut_for_newer_ones() -> None:
    async with listening(most=4) as listener:
        reader, writer = await asyncio.open_connection("127.0.0.1", listener.port, limit=PIECE)
        writer.write(ASKED.replace(b"GET /", b"GET /long"))
        await reader.readline()
        idle = [await opened(listener) for _ in range(10)]
        try:
            assert b"hello" in await answered(listener)
            header = await reader.readuntil(b"\r\n\r\n")
            assert b"content-length" in header.lower()
            assert len(await reader.readexactly(len(LONG))) == len(LONG)
        finally:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()
            for client in idle:
                client.close()


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nX: ", ASKED.replace(b"GET /", b"GET /long")])
@pytest.mark.parametrize("address", [FLOODER, "127.0.0.1"])
async def test_connections_half_open_at_every_place_keep_no_browser_out(address: str, said: bytes) -> None:
    async with listening(most=8) as listener:
        flood = [await opened(listener, address, said) for _ in range(40)]
        try:
            for _ in range(5):
                assert b"hello" in await answered(listener)
        finally:
            for client in flood:
                client.close()


async def test_silent_connections_take_few_places() -> None:
    async with listening() as listener:
        flood = [await opened(listener, FLOODER) for _ in range(3 * serving.MAX_ARRIVING)]
        try:
            assert b"hello" in await answered(listener)
            assert listener.connections() <= serving.MAX_ARRIVING + 1
            assert await is_cut(flood[0])
        finally:
            for client in flood:
                client.close()


async def test_a_browser_that_rests_is_not_cut_for_the_many_connections_of_another_address() -> None:
    async with listening(most=8) as listener:
        reader, writer = await asyncio.open_connection("127.0.0.1", listener.port)
        flood = [await opened(listener, FLOODER) for _ in range(40)]
        try:
            assert await is_cut(flood[0])
            writer.write(ASKED)
            assert b"200" in await reader.readline()
        finally:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()
            for client in flood:
                client.close()


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nX: ", ASKED.replace(b"GET /", b"GET /long")])
async def test_who_is_quiet_is_cut(monkeypatch: pytest.MonkeyPatch, said: bytes) -> None:
    monkeypatch.setattr(serving, "QUIET_S", 0.2)
    async with listening() as listener:
        client = await opened(listener)
        there = listener.connections
        try:
            await asyncio.get_running_loop().sock_sendall(client, said)
            await until(lambda: there() == 1)

            def cut() -> bool:
                listener.cut_lingering()
                return there() == 0

            await until(cut, what="the quiet one to be cut")
            assert b"hello" in await answered(listener)
        finally:
            client.close()


async def test_who_asks_again_and_again_is_not_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving, "QUIET_S", 1.0)
    async with listening() as listener:
        reader, writer = await asyncio.open_connection("127.0.0.1", listener.port)
        loop = asyncio.get_running_loop()
        end_s = loop.time() + 2.5
        while loop.time() < end_s:
            writer.write(ASKED)
            assert b"200" in await reader.readline()
            await reader.readuntil(b"hello")
            listener.cut_lingering()
            await asyncio.sleep(0.05)
        writer.close()
        await writer.wait_closed()


async def test_of_who_does_not_read_little_is_kept() -> None:
    async with listening() as listener:
        clients = [await opened(listener) for _ in range(5)]
        tracemalloc.start()
        try:
            gc.collect()
            before, _ = tracemalloc.get_traced_memory()
            for client in clients:
                await asyncio.get_running_loop().sock_sendall(client, ASKED.replace(b"GET /", b"GET /long"))
            await until(lambda: listener.connections() == 5)
            await asyncio.sleep(0.3)
            after, _ = tracemalloc.get_traced_memory()
            assert after - before < 5 * 8 * PIECE
        finally:
            tracemalloc.stop()
            for client in clients:
                client.close()


def secured(path: Path) -> tuple[ssl.SSLContext, ssl.SSLContext]:
    """Return the contexts of a server and of its clients."""
    kept = obtain(path, ["127.0.0.1"], "bench", dt.datetime.now(dt.UTC))
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(kept.certificate, kept.key)
    return tls, ssl.create_default_context(cafile=kept.certificate)


async def test_a_slow_handshake_is_not_cut_for_the_many_of_another_address(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(serving, "MAX_ARRIVING", 4)
    tls, trust = secured(tmp_path)
    async with listening(tls) as listener:
        phone = await opened(listener)
        flood = [await opened(listener, FLOODER) for _ in range(40)]
        try:
            assert await is_cut(flood[0])
            reader, writer = await asyncio.open_connection(sock=phone, ssl=trust, server_hostname="127.0.0.1")
            writer.write(ASKED)
            assert b"200" in await reader.readline()
            await reader.readuntil(b"hello")
            writer.close()
            await writer.wait_closed()
        finally:
            for client in flood:
                client.close()


async def test_tls_that_is_never_agreed_keeps_nobody_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(serving, "MAX_ARRIVING", 4)
    tls, trust = secured(tmp_path)
    async with listening(tls) as listener:
        silent = [socket.create_connection(("127.0.0.1", listener.port)) for _ in range(60)]  # all at once
        try:
            reader, writer = await asyncio.open_connection("127.0.0.1", listener.port, ssl=trust)
            writer.write(ASKED)
            async with asyncio.timeout(60.0):
                assert b"200" in await reader.readline()
            for client in silent:
                client.setblocking(False)
            assert [await is_cut(client) for client in silent[:50]] == [True] * 50
            writer.close()
            await writer.wait_closed()
        finally:
            for client in silent:
                client.close()
