"""Packets of brokers that are too long are not read, in both versions of MQTT."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import aiomqtt
import pytest

from pointit.runtime.mqtt import broker
from pointit.runtime.mqtt.broker_config import BrokerConfig

pytestmark = pytest.mark.wall_time
CONNECT = 0x10
PUBLISH = 0x30
TOPIC = b"a"
CONNACKS = {4: bytes.fromhex("20020000"), 5: bytes.fromhex("2003000000")}


def length_field(length: int) -> bytes:
    """Return the remaining length of a packet: seven bits a byte, the lowest first."""
    field = bytearray()
    while True:
        length, digit = divmod(length, 128)
        field.append(digit | (128 if length else 0))
        if not length:
            return bytes(field)


class EndlessBroker:
    """Accepts a client by MQTT `version`, and sends one message of `size` bytes as far as it is read."""

    def __init__(self, version: int, size: int) -> None:
        self._version = version
        self._size = size
        self.sent = 0
        self.connects: list[bytes] = []

    @asynccontextmanager
    async def serving(self) -> AsyncGenerator[int]:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        async with server:
            yield server.sockets[0].getsockname()[1]

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            kind, length = await reader.readexactly(2)
            connect = await reader.readexactly(length)
            assert kind == CONNECT
            self.connects.append(connect)
            writer.write(CONNACKS[self._version])
            is_probe = len(connect) < 20  # without a client identifier
            if self._version == 5 or not is_probe:
                writer.write(bytes([PUBLISH]) + length_field(self._size + 2 + len(TOPIC)))
                writer.write(len(TOPIC).to_bytes(2, "big") + TOPIC)
                while self.sent < self._size:
                    chunk = b"x" * min(2**16, self._size - self.sent)
                    writer.write(chunk)
                    await writer.drain()
                    self.sent += len(chunk)
                await reader.read()
        except (ConnectionError, asyncio.IncompleteReadError):
            pass
        finally:
            writer.transport.abort()


@pytest.mark.parametrize("version", [4, 5])
async def test_message_that_is_too_long_ends_the_connection_before_it_is_read(
    version: int, caplog: pytest.LogCaptureFixture
) -> None:
    endless = EndlessBroker(version, 200 * 2**20)
    async with endless.serving() as port:
        options = broker.client_options(BrokerConfig(broker=f"127.0.0.1:{port}"))
        async with asyncio.timeout(20):
            with pytest.raises((aiomqtt.MqttError, OSError)):
                async with broker.connected(options) as client:
                    await anext(client.messages)
    assert endless.sent < 32 * 2**20, "what the system's buffers take"
    assert "the broker sends a message of 200 MB, more than 1 are not read" in caplog.text
    if version == 5:
        size = broker.MAX_PACKET_BYTES.to_bytes(4, "big")
        assert b"\x27" + size in endless.connects[-1], "brokers of MQTT 5 send none"
