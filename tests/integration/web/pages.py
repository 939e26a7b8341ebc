"""A web service on a bench, and pages that open it."""

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

import httpx
import msgpack
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Origin

from pointit.bridges.web import service
from pointit.bridges.web.config import WebConfig
from pointit.runtime.service.service import Launch, run_service
from tests.support.bench import Bench, until
from tests.support.buses import free_port

OPERATOR = "operator-token"
VIEWER = "viewer-token"

INDEX = "<!doctype html><title>page</title>" + "<!-- long -->" * 200


class Server:
    def __init__(self, port: int) -> None:
        self.host = f"127.0.0.1:{port}"
        self.url = f"http://{self.host}"

    def client(self, **headers: str) -> httpx.AsyncClient:
        return httpx.AsyncClient(base_url=self.url, headers=headers, timeout=60.0)

    async def cookie(self, token: str = OPERATOR) -> str:
        async with self.client() as client:
            answer = await client.get("/", params={"token": token})
        assert answer.status_code == 303, answer.text
        return answer.headers["set-cookie"].partition(";")[0]

    def connect(self, cookie: str, path: str = "/ws") -> connect:
        headers = {"Cookie": cookie}
        return connect(f"ws://{self.host}{path}", origin=Origin(self.url), additional_headers=headers)

    @asynccontextmanager
    async def page(
        self,
        token: str = OPERATOR,
        *,
        acknowledges: bool = True,
        path: str = "/ws",
        cookies: str = "",
        hangs_up: bool = False,
    ) -> AsyncGenerator["Page"]:
        """Open a page.

        `hangs_up`: it ends without the closing handshake, which a server that has stopped reading would leave
        unanswered for ten seconds.
        """
        async with self.connect(await self.cookie(token) + cookies, path) as socket:
            page = Page(socket, acknowledges=acknowledges)
            reading = asyncio.create_task(page.read())
            try:
                await until(lambda: page.hello is not None, what="the hello")
                yield page
            finally:
                reading.cancel()
                await asyncio.gather(reading, return_exceptions=True)
                if hangs_up:
                    socket.transport.abort()


class Page:
    def __init__(self, socket: ClientConnection, *, acknowledges: bool) -> None:
        self.socket = socket
        self.acknowledges = acknowledges
        self.hello: dict[str, Any] | None = None
        self.status: dict[str, Any] = {}
        self.statuses = 0
        self.answers: dict[int, dict[str, Any]] = {}
        self.timeline: dict[str, Any] = {}
        """Sent to pages with a playback, as is `playing`."""
        self.playing: dict[str, Any] = {}
        self.states: dict[tuple[str, str], dict[str, Any]] = {}
        self.events: list[tuple[str, str, dict[str, Any]]] = []
        self.batches: list[int] = []
        self.dropped = 0
        self._asks = 0

    async def read(self) -> None:
        async for message in self.socket:
            if isinstance(message, bytes):
                await self._take(message)
            else:
                self._hear(json.loads(message))

    async def say(self, **said: Any) -> None:
        await self.socket.send(json.dumps(said))

    async def ask(self, **ask: Any) -> dict[str, Any]:
        self._asks += 1
        number = self._asks
        await self.say(kind="ask", id=number, **ask)
        await until(lambda: number in self.answers, what=f"the answer to {ask}")
        return self.answers[number]

    def person(self, user: str) -> dict[str, Any]:
        lines = [line for line in self.status.get("people", ()) if line["user"] == user]
        return lines[0] if lines else {}

    def _hear(self, said: dict[str, Any]) -> None:
        if said["kind"] == "hello":
            self.hello = said
        elif said["kind"] == "status":
            self.status = said
            self.statuses += 1
        elif said["kind"] == "timeline":
            self.timeline = said
        elif said["kind"] == "playing":
            self.playing = said
        else:
            self.answers[said["id"]] = said

    async def _take(self, batch: bytes) -> None:
        assert self.hello is not None, "a batch before the hello"
        n, _sent_ns, _speed, states, events, dropped = msgpack.unpackb(batch)
        self.batches.append(n)
        self.dropped += dropped
        for topic, name, payload in states:
            if payload is None:
                self.states.pop((topic, name), None)
            else:
                self.states[topic, name] = msgpack.unpackb(payload)
        self.events += [(topic, name, msgpack.unpackb(payload)) for topic, name, payload in events]
        if self.acknowledges:
            await self.say(kind="ack", n=n, latency_ms=12.5)


async def serve(bench: Bench, port: int, **parameters: Any) -> None:
    config = WebConfig.model_validate(
        {"port": port, "operator_token": OPERATOR, "viewer_token": VIEWER, **parameters}
    )
    await run_service(Launch(service=service.SERVICE, config=config), bench.bus, bench.clock)


@asynccontextmanager
async def serving(bench: Bench, **parameters: Any) -> AsyncGenerator[Server]:
    port = parameters.pop("port", None) or free_port()
    life = asyncio.create_task(serve(bench, port, **parameters))
    server = Server(port)
    try:
        async with asyncio.timeout(60.0):
            await _listening(port, life)
        yield server
    finally:
        life.cancel()
        await asyncio.gather(life, return_exceptions=True)


async def _listening(port: int, life: asyncio.Task[None]) -> None:
    """Return when somebody listens, or when who should has ended; raise what ended them."""
    while not life.done():
        with contextlib.suppress(OSError):
            _, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.close()
            await writer.wait_closed()
            return
        await asyncio.sleep(0.002)
    life.result()
