"""An MQTT broker of a test that refuses, as brokers of other makers do and mosquitto does not."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

CONNECT, PUBLISH, SUBSCRIBE, UNSUBSCRIBE, PING = 1, 3, 8, 10, 12
REFUSED = 0x80
TAKEN_OVER = b"\xe0\x02\x8e\x00"
"""DISCONNECT of MQTT 5 with the reason that another client has the session."""


def _text(value: bytes) -> bytes:
    return len(value).to_bytes(2, "big") + value


def _packet(first: int, body: bytes) -> bytes:
    size = len(body)
    digits = bytearray()
    while True:
        size, digit = divmod(size, 128)
        digits.append(digit | (0x80 if size else 0))
        if not size:
            return bytes([first, *digits]) + body


def _matches(pattern: str, topic: str) -> bool:
    levels = topic.split("/")
    wanted = pattern.split("/")
    if wanted[-1] == "#":
        wanted = wanted[:-1]
        levels = levels[: len(wanted)]
    if len(wanted) != len(levels):
        return False
    return all(part in ("+", level) for part, level in zip(wanted, levels, strict=True))


@dataclass
class OldBroker:
    """Broker of MQTT 3.1.1: its answers, and a record of the packets that it received."""

    refused: Sequence[str] = ()
    """Beginnings of filters that are answered by 0x80."""
    retained: Mapping[str, bytes] = field(default_factory=dict[str, bytes])
    closes_after: int = 0
    """Kind of the packet after which the connection is closed without an answer, 0 for none."""
    takes_over: bool = False
    """True to speak MQTT 5, and to end a session when the next client connects."""
    published: list[tuple[str, bytes]] = field(default_factory=list[tuple[str, bytes]])
    port: int = 0
    _session: asyncio.StreamWriter | None = None

    @asynccontextmanager
    async def running(self) -> AsyncGenerator["OldBroker"]:
        serving: set[asyncio.Task[None]] = set()

        def begin(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            serving.add(asyncio.create_task(self._serve(reader, writer)))

        async with await asyncio.start_server(begin, "127.0.0.1", 0) as server:
            self.port = server.sockets[0].getsockname()[1]
            yield self
            for each in serving:
                each.cancel()
            await asyncio.gather(*serving, return_exceptions=True)
            await asyncio.sleep(0)  # closes their sockets

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError, EOFError), contextlib.closing(writer.transport):
            while True:
                first = (await reader.readexactly(1))[0]
                size = shift = 0
                digit = 0x80
                while digit & 0x80:
                    digit = (await reader.readexactly(1))[0]
                    size |= (digit & 0x7F) << shift
                    shift += 7
                body = await reader.readexactly(size)
                if first >> 4 == self.closes_after:
                    break
                writer.write(self._answer(first, body, writer))

    def _answer(self, first: int, body: bytes, writer: asyncio.StreamWriter) -> bytes:
        match first >> 4:
            case 1:  # CONNECT
                return self._begin(writer, has_name=body[-2:] != b"\x00\x00")
            case 3:  # PUBLISH
                return self._publish(first, body)
            case 8:  # SUBSCRIBE
                return self._subscribe(body)
            case 10:  # UNSUBSCRIBE
                return _packet(0xB0, body[:2])
            case 12:  # PINGREQ
                return b"\xd0\x00"
            case _:
                return b""

    def _begin(self, writer: asyncio.StreamWriter, *, has_name: bool) -> bytes:
        if not self.takes_over:
            return b"\x20\x02\x00\x00"
        if has_name:
            if self._session is not None:
                self._session.write(TAKEN_OVER)
                self._session.close()
            self._session = writer
        return b"\x20\x03\x00\x00\x00"

    def _publish(self, first: int, body: bytes) -> bytes:
        end = 2 + int.from_bytes(body[:2], "big")
        has_number = bool(first & 6)
        start = end + 2 * has_number
        self.published.append((body[2:end].decode(), body[start:]))
        return _packet(0x40, body[end:start]) if has_number else b""

    def _subscribe(self, body: bytes) -> bytes:
        number = body[:2]
        at = 3 if self.takes_over else 2  # MQTT 5 has properties, here none
        codes = bytearray()
        granted: list[str] = []
        while at < len(body):
            end = at + 2 + int.from_bytes(body[at : at + 2], "big")
            pattern = body[at + 2 : end].decode()
            is_refused = pattern.startswith(tuple(self.refused))
            codes.append(REFUSED if is_refused else 0)
            if not is_refused:
                granted.append(pattern)
            at = end + 1
        properties = b"\x00" if self.takes_over else b""
        answers = [_packet(0x90, number + properties + bytes(codes))]
        # what is retained comes once, whatever the number of patterns that it matches
        for topic, payload in self.retained.items():
            if any(_matches(pattern, topic) for pattern in granted):
                answers.append(_packet(0x31, _text(topic.encode()) + payload))
        return b"".join(answers)
