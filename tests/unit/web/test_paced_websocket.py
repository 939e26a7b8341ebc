"""A websocket's transport is paused before more is parsed than its reader takes."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio
import uvicorn
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.server import ServerState
from websockets.frames import Frame, Opcode

from pointit.bridges.web.server import paced_websocket
from pointit.bridges.web.server.paced_websocket import CONTROL_BURST, READ_BYTES, PacedWebSocket
from tests.support.bench import until

HANDSHAKE = (
    b"GET /ws HTTP/1.1\r\nHost: page\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)
MESSAGE = Frame(Opcode.TEXT, b'{"kind":"ack","n":1}').serialize(mask=True)
PING = Frame(Opcode.PING, b"").serialize(mask=True)
PART = Frame(Opcode.CONT, b"", fin=False).serialize(mask=True)


class FakeTransport(asyncio.Transport):
    """Transport that records the bytes that the protocol writes, and whether it reads."""

    def __init__(self) -> None:
        super().__init__()
        self.reads = True
        self.is_closed = False
        self.written = b""

    def pause_reading(self) -> None:
        self.reads = False

    def resume_reading(self) -> None:
        self.reads = True

    def is_closing(self) -> bool:
        return self.is_closed

    def write(self, data: Any) -> None:
        self.written += bytes(data)

    def close(self) -> None:
        self.is_closed = True


class Connection:
    """A client that sends, and an application that receives only when it is told to."""

    def __init__(self) -> None:
        self.transport = FakeTransport()
        self.received: list[str] = []
        self._may_receive = asyncio.Semaphore(0)
        config = uvicorn.Config(self._serve, ws=PacedWebSocket, interface="asgi3", log_config=None)
        config.load()
        self.protocol = PacedWebSocket(config=config, server_state=ServerState(), app_state={})
        self.protocol.connection_made(self.transport)
        self.protocol.data_received(HANDSHAKE)

    async def _serve(self, _scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        while True:
            await self._may_receive.acquire()
            message = await receive()
            if message["type"] == "websocket.disconnect":
                return
            self.received.append(message["text"])

    async def receive(self, count: int) -> None:
        for _ in range(count):
            self._may_receive.release()
        for _ in range(4 * count + 4):
            await asyncio.sleep(0)

    def send(self, data: bytes) -> int:
        """Deliver `data` as a transport does, until it is paused. Return the number of delivered bytes."""
        sent = 0
        while sent < len(data) and self.transport.reads:
            buffer = self.protocol.get_buffer(-1)
            count = min(len(buffer), len(data) - sent)
            buffer[:count] = data[sent : sent + count]
            self.protocol.buffer_updated(count)
            sent += count
        return sent

    @property
    def waiting(self) -> int:
        """Return the number of parsed messages that the application has not received."""
        return self.protocol.queue.qsize()


@pytest_asyncio.fixture
async def connection() -> AsyncIterator[Connection]:
    opened = Connection()
    await opened.receive(0)
    assert b" 101 " in opened.transport.written
    yield opened
    opened.protocol.connection_lost(None)
    await opened.receive(opened.waiting + 1)


async def test_messages_are_not_parsed_while_one_is_unreceived(connection: Connection) -> None:
    assert connection.send(MESSAGE * 10_000) <= READ_BYTES
    assert connection.waiting <= READ_BYTES / len(MESSAGE)
    assert not connection.transport.reads

    await connection.receive(connection.waiting)

    assert connection.transport.reads, "all that were parsed are received"


async def test_transport_is_paused_when_control_frames_exceed_the_limit(connection: Connection) -> None:
    sent = connection.send(PING * 10_000)

    assert not connection.transport.reads
    assert sent <= CONTROL_BURST * len(PING) + READ_BYTES


async def test_parts_of_a_message_count_as_control_frames(connection: Connection) -> None:
    connection.send(Frame(Opcode.TEXT, b"[", fin=False).serialize(mask=True))

    sent = connection.send(PART * 10_000)

    assert not connection.transport.reads
    assert sent <= CONTROL_BURST * len(PART) + READ_BYTES


async def test_messages_after_a_close_by_the_server_are_limited(connection: Connection) -> None:
    await connection.protocol.send({"type": "websocket.close", "code": 1008, "reason": "enough"})

    sent = connection.send(MESSAGE * 10_000)

    assert not connection.transport.reads
    assert sent <= CONTROL_BURST * len(MESSAGE) + READ_BYTES


async def test_client_is_gone_when_it_does_not_answer_a_ping(connection: Connection) -> None:
    connection.protocol.keepalive_timeout()

    with pytest.raises(ClientDisconnected):  # an OSError, by which Starlette tells that a client has gone
        await connection.protocol.send({"type": "websocket.send", "text": "too late"})


async def test_reading_resumes_with_the_allowance(connection: Connection) -> None:
    connection.protocol._control_bucket = paced_websocket.TokenBucket(1000.0, 2.0)
    connection.send(PING * 4)
    assert not connection.transport.reads

    await until(lambda: connection.transport.reads)


async def test_receiving_does_not_resume_a_client_over_its_limit(connection: Connection) -> None:
    connection.send(MESSAGE + PING * int(CONTROL_BURST + 1))
    assert connection.waiting == 1

    await connection.receive(1)

    assert len(connection.received) == 1
    assert not connection.transport.reads


async def test_allowance_does_not_resume_while_a_message_is_unreceived(connection: Connection) -> None:
    connection.protocol._control_bucket = paced_websocket.TokenBucket(1000.0, 2.0)
    connection.send(MESSAGE + PING * 3)
    assert connection.protocol._is_over_limit

    await until(lambda: not connection.protocol._is_over_limit)

    assert not connection.transport.reads


async def test_message_in_many_reads_arrives(connection: Connection) -> None:
    long = "x" * (4 * READ_BYTES)
    data = Frame(Opcode.TEXT, long.encode()).serialize(mask=True)

    assert connection.send(data) == len(data)
    await connection.receive(1)

    assert connection.received == [long]
