"""Pages without a browser."""

import asyncio
import json
import time
from typing import Any
from urllib.parse import urlsplit

import httpx
import msgpack
from websockets.asyncio.client import connect


async def look_on(url: str, count: int, duration_s: float) -> None:
    """Open `count` viewing pages at the same time with `url`'s token, which acknowledge at once."""
    async with httpx.AsyncClient() as client:
        answer = await client.get(url)
    cookie = answer.headers["set-cookie"].partition(";")[0]
    async with asyncio.TaskGroup() as group:
        for _ in range(count):
            group.create_task(_acknowledge(url, cookie, duration_s))


async def _acknowledge(url: str, cookie: str, duration_s: float) -> None:
    parts = urlsplit(url)
    origin: Any = f"{parts.scheme}://{parts.netloc}"
    async with connect(
        f"ws://{parts.netloc}/ws", origin=origin, additional_headers={"Cookie": cookie}, max_size=None
    ) as connection:
        end_s = time.monotonic() + duration_s
        while (now_s := time.monotonic()) < end_s:
            async with asyncio.timeout(end_s + 10.0 - now_s):
                message = await connection.recv()
            if not isinstance(message, str):
                batch = msgpack.unpackb(message)
                acknowledgement = {"kind": "ack", "n": batch[0], "latency_ms": None}
                await connection.send(json.dumps(acknowledgement))
