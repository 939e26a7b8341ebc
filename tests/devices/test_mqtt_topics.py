"""A broker that forwards messages whose topic no client can decode, as those do that check none."""

import asyncio
import contextlib
import logging
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from pointit.runtime.errors import ConfigError
from pointit.runtime.mqtt.broker import client_options, connected, keep_connected
from pointit.runtime.mqtt.broker_config import BrokerConfig
from tests.support.bench import background, until

CONNECT = 1
SUBSCRIBE = 8
PUBREC = 5
PUBREL = 6


def publish(topic: bytes, qos: int = 0) -> bytes:
    body = len(topic).to_bytes(2, "big") + topic + (b"\0\7" if qos else b"") + b"x"
    return bytes([0x30 | (qos << 1), len(body)]) + body


INVALID = {
    "bytes": publish(b"a/\xff\xfe"),
    "acknowledged": publish(b"a/\xff", qos=1),
    "acknowledged twice": publish(b"a/\xff", qos=2),
    "half a surrogate": publish(b"a/\xed\xa0\x80"),
    "wildcard": publish(b"a/#"),
    "plus": publish(b"+/b"),
}


@contextlib.asynccontextmanager
async def forwarding(packets: bytes) -> AsyncGenerator[tuple[dict[str, Any], list[int]]]:
    """Run a broker that answers each subscription with `packets`. Yield its options and types of packets."""
    heard: list[int] = []
    serving: set[asyncio.Task[None]] = set()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(asyncio.IncompleteReadError, OSError):
            while True:
                first, length = await reader.readexactly(2)
                body = await reader.readexactly(length)
                heard.append(first >> 4)
                if heard[-1] == CONNECT:
                    writer.write(b"\x20\2\0\0")
                elif heard[-1] == SUBSCRIBE:
                    writer.write(b"\x90\3" + body[:2] + b"\0" + packets)
                elif heard[-1] == PUBREC:
                    writer.write(b"\x62\2" + body[:2])
        writer.close()

    def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        serving.add(asyncio.create_task(serve(reader, writer)))

    async with await asyncio.start_server(accept, "127.0.0.1", 0) as server:
        yield {"hostname": "127.0.0.1", "port": server.sockets[0].getsockname()[1]}, heard
        await asyncio.gather(*serving)


@pytest.mark.parametrize("packet", INVALID.values(), ids=INVALID.keys())
async def test_message_with_an_invalid_topic_is_ignored_without_a_disconnect(
    packet: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    topics: list[str] = []
    lost: list[str] = []
    async with forwarding(packet + publish(b"a/b") + packet + publish(b"a/c")) as (options, heard):

        async def serve() -> None:
            async with connected(options) as client:
                await client.subscribe("#")
                async for message in client.messages:
                    topics.append(str(message.topic))

        async with background(keep_connected(serve, lost.append, has_user=False, retry_s=0.0)):
            await until(lambda: "a/c" in topics, what="the last message")
    assert (topics, lost) == (["a/b", "a/c"], [])
    assert heard.count(SUBSCRIBE) == 1
    (warning,) = [each for each in caplog.records if each.name.startswith("pointit.runtime.mqtt")]
    assert warning.levelno == logging.WARNING
    assert "whose topic is not valid are ignored" in warning.getMessage()


async def test_connection_that_ends_by_an_exception_leaves_no_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    async with forwarding(publish(b"a/b")) as (options, _heard):
        for _ in range(3):
            async with connected(options) as client:
                monkeypatch.setattr(client._client, "loop_read", lambda: 1 // 0)  # pyrefly: ignore[division-by-zero]
                client._client.subscribe("#")
                with pytest.raises(aiomqtt.MqttError):
                    await anext(client.messages)
                connection = client._client.socket()
            assert connection is not None
            assert connection.fileno() < 0


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"pa\xffss", "is not in UTF-8"),
        (b"x" * 70000, "exceeds 65535 bytes"),
        (b"open", "others can read it; make it yours alone with `chmod 600"),
        (None, "does not exist"),
    ],
)
def test_unusable_password_file_is_an_error_without_its_content(
    tmp_path: Path, content: bytes | None, sentence: str
) -> None:
    file = tmp_path / "secret"
    if content is not None:
        file.write_bytes(content)
        file.chmod(0o644 if content == b"open" else 0o600)
    with pytest.raises(ConfigError, match=sentence) as caught:
        client_options(BrokerConfig(broker="hub", username="me", password_file=str(file)))
    assert "xff" not in str(caught.value)
    assert caught.value.__cause__ is None or not isinstance(caught.value.__cause__, UnicodeError)
