"""Visitors of a page who may only look: as many as a script wants, of one kind.

`python -m tests.faults.page_visitors LINK KIND COUNT`, where LINK is the page's link for viewing. All open
the page, a line is printed when all are in, and they go on until the process is killed. A visitor that is
cut off comes back after `RETURN_S`. They are polite to the machine (`nice`), since genuine ones have their
own.
"""

import asyncio
import contextlib
import itertools
import json
import os
import sys
from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

import httpx
import msgpack
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException
from websockets.typing import Origin

RETURN_S = 0.25
"""Time after which a page that was closed is opened again, as browsers do first, s."""
BEGUN = "all visitors are in"


async def acknowledge(socket: ClientConnection, on_batch: Callable[[int], None] | None = None) -> None:
    """Acknowledge each batch, as a page does that shows it."""
    async for message in socket:
        if isinstance(message, bytes):
            number = msgpack.unpackb(message)[0]
            await socket.send(json.dumps({"kind": "ack", "n": number, "latency_ms": 20.0}))
            if on_batch is not None:
                on_batch(number)


async def look(socket: ClientConnection) -> None:
    """Look on politely."""
    await acknowledge(socket)


async def ask(socket: ClientConnection) -> None:
    """Ask for the largest answer as fast as the socket takes it."""

    async def ask_again() -> None:
        for number in itertools.count():
            await socket.send(json.dumps({"kind": "ask", "id": number, "deed": "told_apart"}))

    await _both(acknowledge(socket), ask_again())


async def repeat(socket: ClientConnection) -> None:
    """Acknowledge the first batch again and again as fast as the socket takes it."""
    has_come = asyncio.Event()

    async def acknowledge_again() -> None:
        await has_come.wait()
        text = json.dumps({"kind": "ack", "n": 1, "latency_ms": 20.0})
        while True:
            await socket.send(text)

    await _both(acknowledge(socket, lambda _: has_come.set()), acknowledge_again())


async def ping(socket: ClientConnection) -> None:
    """Send frames that are no messages as fast as the socket takes them."""

    async def ping_again() -> None:
        while True:
            asyncio.ensure_future(await socket.ping()).cancel()  # nobody waits for the pong

    await _both(acknowledge(socket), ping_again())


KINDS: dict[str, Callable[[ClientConnection], Awaitable[None]]] = {
    "looking": look,
    "asking": ask,
    "repeating": repeat,
    "pinging": ping,
}


async def _both(*works: Awaitable[None]) -> None:
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def visit(link: str, kind: str, on_open: Callable[[], None]) -> None:
    """Visit the page again and again."""
    parts = urlsplit(link)
    origin = f"{parts.scheme}://{parts.netloc}"
    async with httpx.AsyncClient() as client:
        answer = await client.get(link)
    cookie = answer.headers["set-cookie"].partition(";")[0]
    address = f"{origin.replace('http', 'ws', 1)}/ws"
    while True:
        with contextlib.suppress(WebSocketException, OSError, TimeoutError):
            opening = connect(
                address, origin=Origin(origin), additional_headers={"Cookie": cookie}, open_timeout=60
            )
            async with opening as socket:
                on_open()
                await KINDS[kind](socket)
        await asyncio.sleep(RETURN_S)


async def main(link: str, kind: str, count: int) -> None:
    """Have `count` visitors of a kind."""
    is_in = [False] * count

    def on_open(index: int) -> None:
        was_complete = all(is_in)
        is_in[index] = True
        if all(is_in) and not was_complete:
            print(BEGUN, flush=True)  # noqa: T201 - for who has started it

    async with asyncio.TaskGroup() as group:
        for index in range(count):
            group.create_task(visit(link, kind, lambda index=index: on_open(index)))


if __name__ == "__main__":
    os.nice(19)
    asyncio.run(main(sys.argv[1], sys.argv[2], int(sys.argv[3])))
