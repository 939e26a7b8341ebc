"""A genuine MQTT broker for one test."""

import shutil
import subprocess
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

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
