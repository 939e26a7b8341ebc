"""Pages without a browser, many in a process of their own: `python -m tests.support.bare_pages URL 50 10`."""

import asyncio
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import msgpack
from websockets.asyncio.client import ClientConnection, connect

SETTLE_S = 1.0
"""The first batches, which bring everything, are not counted."""


class Counting(ClientConnection):
    size = 0

    def data_received(self, data: bytes) -> None:
        """Count and process bytes of the network."""
        self.size += len(data)
        super().data_received(data)


@dataclass
class BarePage:
    """Acknowledges every batch as soon as it has it; measures what it gets."""

    latencies_ms: list[float] = field(default_factory=list[float])
    """From capture at the wrist, or drawing where no wrist has moved, to receiving the frame of light."""
    batches: int = 0
    size: int = 0
    """Bytes, before the socket's compression."""
    wire_size: int = 0
    """Bytes that came over the network."""
    longest_gap_s: float = 0.0

    async def look_on(self, url: str, cookie: str, duration_s: float) -> None:
        """Open the socket and measure for `duration_s`, after a second to settle."""
        parts = urlsplit(url)
        origin: Any = f"{parts.scheme}://{parts.netloc}"
        socket = f"ws://{parts.netloc}/ws"
        async with connect(
            socket,
            origin=origin,
            additional_headers={"Cookie": cookie},
            max_size=None,
            create_connection=Counting,
        ) as connection:
            assert isinstance(connection, Counting)
            begin_s = time.monotonic() + SETTLE_S
            last_s = begin_s
            while (now_s := time.monotonic()) < begin_s + duration_s:
                async with asyncio.timeout(begin_s + duration_s + 10.0 - now_s):
                    message = await connection.recv()
                if isinstance(message, str):
                    continue
                now_s, now_ns = time.monotonic(), time.time_ns()
                batch = msgpack.unpackb(message)
                await connection.send(json.dumps({"kind": "ack", "n": batch[0], "latency_ms": None}))
                if now_s < begin_s:
                    connection.size = 0
                    continue
                self.longest_gap_s = max(self.longest_gap_s, now_s - last_s)
                last_s = now_s
                self._take(len(message), batch[3], now_ns)
            self.longest_gap_s = max(self.longest_gap_s, time.monotonic() - last_s)
            self.wire_size = connection.size

    def _take(self, size: int, states: Sequence[tuple[str, str, bytes | None]], now_ns: int) -> None:
        self.batches += 1
        self.size += size
        for topic, _name, payload in states:
            if topic == "strips/frame" and payload is not None:
                self.latencies_ms.append((now_ns - msgpack.unpackb(payload)["stamp_ns"]) / 1e6)

    def as_dict(self) -> dict[str, Any]:
        return {
            "batches": self.batches,
            "bytes": self.size,
            "wire_bytes": self.wire_size,
            "longest_gap_s": self.longest_gap_s,
            "latencies_ms": self.latencies_ms,
        }


async def look_on(url: str, count: int, duration_s: float) -> list[BarePage]:
    """Open `count` viewing pages at the same time, with `url`'s token."""
    async with httpx.AsyncClient() as client:
        answer = await client.get(url)
    cookie = answer.headers["set-cookie"].partition(";")[0]
    pages = [BarePage() for _ in range(count)]
    async with asyncio.TaskGroup() as group:
        for page in pages:
            group.create_task(page.look_on(url, cookie, duration_s))
    return pages


async def elsewhere(url: str, count: int, duration_s: float) -> list[dict[str, Any]]:
    """Open the pages in a process of its own, and return the measurements of each.

    Raises:
        RuntimeError: If that process failed.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "tests.support.bare_pages", url, str(count), str(duration_s)),
        stdout=asyncio.subprocess.PIPE,
        cwd=Path(__file__).parents[2],
    )
    try:
        out, _ = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode:
        raise RuntimeError(f"{count} pages ended with {process.returncode}")
    pages: list[dict[str, Any]] = json.loads(out)
    return pages


if __name__ == "__main__":
    looked = asyncio.run(look_on(sys.argv[1], int(sys.argv[2]), float(sys.argv[3])))
    sys.stdout.write(json.dumps([page.as_dict() for page in looked]))
