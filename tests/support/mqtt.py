"""A genuine MQTT broker for one test."""

import asyncio
import shutil
import subprocess
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any, Self

import aiomqtt
import pytest

from tests.examples.running import running
from tests.support.bench import until
from tests.support.buses import free_port, is_listening

MOSQUITTO = shutil.which("mosquitto")


@contextmanager
def broker(folder: Path, port: int = 0, options: str = "") -> Generator[int]:
    """Run a broker on this machine for the body, and yield its port, on which it may not listen yet.

    Without `options`, lines of its configuration, it is open to this machine. Its log is in `folder`.
    """
    if MOSQUITTO is None:
        pytest.skip("mosquitto is not installed")
    port = port or free_port()
    words = [MOSQUITTO, "-p", str(port)]
    if options:
        (folder / "mosquitto.conf").write_text(f"listener {port} 127.0.0.1\n{options}", encoding="utf-8")
        words = [MOSQUITTO, "-c", str(folder / "mosquitto.conf")]
    with (folder / "broker.log").open("ab") as log:
        process = subprocess.Popen(words, stdout=log, stderr=log)
        try:
            yield port
        finally:
            process.terminate()
            process.wait(30)


@asynccontextmanager
async def overheard(
    port: int, topic: str, read: Callable[[bytes], Any] = bytes, **login: Any
) -> AsyncGenerator[list[tuple[str, Any]]]:
    """Yield the topics and payloads, as `read` gives them, that come by, as the broker has ordered them."""
    heard: list[tuple[str, Any]] = []

    async def listen() -> None:
        async for message in client.messages:
            assert isinstance(message.payload, bytes)
            heard.append((str(message.topic), read(message.payload)))

    await until(lambda: is_listening(port), what="the broker")
    async with aiomqtt.Client("127.0.0.1", port, **login) as client:
        await client.subscribe(topic, qos=1)
        async with running(listen()):
            yield heard


class Relay:
    """A way to the broker that can break."""

    def __init__(self, port: int) -> None:
        self._broker = port
        self._near: list[asyncio.StreamWriter] = []
        self._far: list[asyncio.StreamWriter] = []
        self._passing: list[asyncio.Task[None]] = []
        self._is_noticed = True
        self.port = 0

    def cut(self, *, is_noticed: bool) -> None:
        """Cut all connections. `is_noticed`: the broker gets to know."""
        self._is_noticed = is_noticed
        for link in self._far if is_noticed else self._near:
            link.transport.abort()

    def silence(self) -> None:
        """Pass nothing on any more. All connections stay open."""
        for link in self._passing:
            link.cancel()

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while data := await reader.read(1000):
                writer.write(data)
        if self._is_noticed:
            writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._broker)
        except OSError:
            writer.close()
            return
        self._near.append(writer)
        self._far.append(far_writer)
        links = (self._pass_on(reader, far_writer), self._pass_on(far_reader, writer))
        self._passing += [asyncio.create_task(link) for link in links]

    @asynccontextmanager
    async def running(self) -> AsyncGenerator[Self]:
        async with await asyncio.start_server(self._serve, "127.0.0.1", 0) as server:
            self.port = server.sockets[0].getsockname()[1]
            yield self
            self.cut(is_noticed=False)
            self.cut(is_noticed=True)
            await asyncio.gather(*self._passing, return_exceptions=True)
