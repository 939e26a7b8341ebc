"""Limits of callers by HTTP, in virtual time: idle sessions and slow bodies."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, AsyncIterator

import httpx

from pointit.assistants.http_server import BODY_TIMEOUT_S, MAX_REQUESTS, MAX_SESSIONS, PATH, SESSION_IDLE_S
from tests.integration.assistants.served import HEADERS, HELLO, OPERATOR, VIEWER, serving

LISTING = {"jsonrpc": "2.0", "id": 2, "method": "tools/list"}


@contextlib.asynccontextmanager
async def clients() -> AsyncGenerator[tuple[httpx.AsyncClient, httpx.AsyncClient]]:
    """Yield an operator's and a viewer's client of a server, without a network."""
    async with serving() as (http, _bus), contextlib.AsyncExitStack() as stack:
        await asyncio.sleep(0.1)

        async def client(token: str) -> httpx.AsyncClient:
            return await stack.enter_async_context(
                httpx.AsyncClient(
                    headers={**HEADERS, "Authorization": f"Bearer {token}"},
                    transport=httpx.ASGITransport(http.app),
                    base_url=http.url.removesuffix(PATH),
                )
            )

        yield await client(OPERATOR), await client(VIEWER)


async def begin(http: httpx.AsyncClient) -> dict[str, str]:
    """Begin a session; return the header that names it."""
    begun = await http.post(PATH, json=HELLO)
    assert begun.status_code == 200
    return {"mcp-session-id": begun.headers["mcp-session-id"]}


async def test_idle_session_ends_within_minutes_and_frees_its_slot() -> None:
    async with clients() as (_, viewer):
        sessions = [await begin(viewer) for _ in range(MAX_SESSIONS)]
        assert (await viewer.post(PATH, json=HELLO)).status_code == 503
        await asyncio.sleep(0.9 * SESSION_IDLE_S)
        assert (await viewer.post(PATH, json=LISTING, headers=sessions[0])).status_code == 200
        await asyncio.sleep(0.2 * SESSION_IDLE_S)
        assert (await viewer.post(PATH, json=LISTING, headers=sessions[0])).status_code == 200, "it was used"
        assert (await viewer.post(PATH, json=LISTING, headers=sessions[1])).status_code == 404, "it was idle"
        for _ in range(MAX_SESSIONS - 1):
            await begin(viewer)


async def test_session_of_a_client_that_listens_does_not_end() -> None:
    async with clients() as (operator, _):
        session = await begin(operator)
        stream = asyncio.create_task(operator.get(PATH, headers=session))
        await asyncio.sleep(3 * SESSION_IDLE_S)
        assert (await operator.post(PATH, json=LISTING, headers=session)).status_code == 200
        stream.cancel()
        await asyncio.wait({stream})


async def endless_body() -> AsyncIterator[bytes]:
    while True:
        yield b" "
        await asyncio.sleep(BODY_TIMEOUT_S / 4)


async def test_endless_bodies_are_refused_in_seconds_and_block_nobody() -> None:
    async with clients() as (operator, viewer):
        slow = [
            asyncio.create_task(viewer.post(PATH, content=endless_body(), headers={"Content-Length": "5000"}))
            for _ in range(MAX_REQUESTS)
        ]
        await asyncio.sleep(0.1)
        refused = await viewer.post(PATH, json=HELLO)
        assert (refused.status_code, "viewer's token are open" in refused.text) == (503, True)
        await begin(operator)
        await asyncio.sleep(BODY_TIMEOUT_S)
        assert {each.result().status_code for each in slow} == {408}
        await begin(viewer)
