"""A server of assistants on a site in memory, and the genuine client of the protocol by HTTP."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator
from urllib.parse import urlsplit

import httpx2
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from pointit.api.site import Site
from pointit.assistants.audit_file import FOLDER, AuditFile
from pointit.assistants.http_server import HttpServer
from pointit.assistants.server import make_server
from pointit.assistants.site_connection import SiteConnection
from pointit.assistants.tools import Role, Tools
from pointit.bridges.web.server.access import Access
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.host.state_file import site_folder
from pointit.schemas import Done, FindReferents, Referents, StopRobot, topics

SITE = "shop"
OPERATOR = "operator-operator-token"
VIEWER = "viewer-viewer-viewer-token"
HELLO = {
    "jsonrpc": "2.0", "id": 1, "method": "initialize",
    "params": {
        "protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "test", "version": "1"}
    },
}  # fmt: skip
HEADERS = {"Accept": "application/json, text/event-stream", "Content-Type": "application/json"}


async def stopped(_query: StopRobot, robot: str) -> Done:
    return Done(message=f"{robot} stands")


async def found(_query: FindReferents, _user: str) -> Referents:
    return Referents()


@contextlib.asynccontextmanager
async def serving(
    most: Role = "operator", *, find: bool = True
) -> AsyncGenerator[tuple[HttpServer, MemoryBus]]:
    """Yield a server that begins to listen, and the bus of its site."""
    bus = MemoryBus()
    bus.announce(topics.USER_ALIVE, "anna")
    bus.serve(topics.STOP_ROBOT, stopped)
    if find:
        bus.serve(topics.FIND_REFERENTS, found)

    door = SiteConnection(lambda: Site.on(bus, WallClock()), "site shop")
    server = make_server(Tools(door, AuditFile(site_folder(SITE, FOLDER)), most, is_remote=True))
    http = HttpServer(server, Access(OPERATOR, VIEWER), "127.0.0.1", 0)
    async with door.opened():
        task = asyncio.create_task(http.run())
        try:
            yield http, bus
        finally:
            # sse-starlette has one task for each loop, which waits for the end of the process
            watching = {each for each in asyncio.all_tasks() if "_shutdown_watcher" in repr(each.get_coro())}
            for each in (task, *watching):
                each.cancel()
            await asyncio.wait({task, *watching})
            await bus.close()


@contextlib.asynccontextmanager
async def served(most: Role = "operator", *, find: bool = True) -> AsyncGenerator[tuple[str, MemoryBus]]:
    """Yield the address of a server that listens, and the bus of its site."""
    async with serving(most, find=find) as (http, bus):
        await wait_for_listener(http.url)
        yield http.url, bus


async def wait_for_listener(url: str) -> None:
    """Wait until connections to `url` are accepted."""
    where = urlsplit(url)
    while True:
        await asyncio.sleep(0)
        with contextlib.suppress(ConnectionRefusedError):
            _, writer = await asyncio.open_connection(where.hostname, where.port)
            writer.close()
            await writer.wait_closed()
            return


@contextlib.asynccontextmanager
async def client_of(url: str, token: str, mode: str = "auto") -> AsyncGenerator[Client]:
    headers = {"Authorization": f"Bearer {token}"}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=30.0) as http,
        Client(streamable_http_client(url, http_client=http), mode=mode) as client,
    ):
        yield client
