"""A fake MQTT broker (version 3.1.1) with one client, such as a hub of lamps."""

import asyncio
import contextlib
from collections.abc import Iterator
from typing import NamedTuple

from pointit.testing.devices import TcpDevice

CONNECT = 1
"""Kind of a packet: the upper four bits of the first byte. So are those below."""
PUBLISH = 3
SUBSCRIBE = 8
PING = 12
CONNACK = b"\x20\x02\x00\x00"
PINGRESP = b"\xd0\x00"


class Published(NamedTuple):
    """A message that the client has published."""

    topic: str
    payload: bytes


class MqttBrokerDevice(TcpDevice):
    """A broker that accepts the program, acknowledges what it sends, and sends nothing by itself."""

    def take(self, published: Published) -> None:
        """Handle a message of the program."""

    async def publish(self, topic: str, payload: bytes) -> None:
        """Send a message to the program, whatever it has subscribed to."""
        name = topic.encode()
        body = len(name).to_bytes(2) + name + payload
        size = bytearray()
        rest = len(body)
        while rest > 0x7F:
            size.append(rest & 0x7F | 0x80)
            rest >>= 7
        size.append(rest)
        head = bytes((PUBLISH << 4,))
        await self.send(head + size + body)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if not self._writers:  # a program may have several connections
            self.received.clear()
        self._writers.add(writer)
        with contextlib.suppress(OSError, asyncio.IncompleteReadError):
            while True:
                packet = await _packet(reader)
                self.received.extend(packet)
                writer.write(_answer(packet))
                for message in published(packet):
                    self.take(message)
        self._writers.discard(writer)
        writer.close()


def published(received: bytes) -> Iterator[Published]:
    """Yield the messages in complete packets."""
    while received:
        size = 0
        start = 1
        while start < len(received) and start <= 4:
            bits = received[start] & 0x7F
            size |= bits << 7 * (start - 1)
            start += 1
            if not received[start - 1] & 0x80:
                break
        end = start + size
        packet = received[:end]
        received = received[end:]
        is_publish = packet[0] >> 4 == PUBLISH
        if is_publish and len(packet) == end:
            topic, payload = _text(packet[start:])
            has_packet_id = packet[0] & 0x06
            if has_packet_id:
                payload = payload[2:]
            yield Published(topic, payload)


async def _packet(reader: asyncio.StreamReader) -> bytes:
    packet = await reader.readexactly(2)
    size = packet[1] & 0x7F
    shift = 7
    while packet[-1] & 0x80:
        packet += await reader.readexactly(1)
        size |= (packet[-1] & 0x7F) << shift
        shift += 7
    return packet + await reader.readexactly(size)


def _answer(packet: bytes) -> bytes:
    kind = packet[0] >> 4
    # a long packet has its size in two bytes
    is_short = packet[1] < 0x80
    body = packet[2:] if is_short else packet[3:]
    if kind == CONNECT:
        return CONNACK
    if kind == PING:
        return PINGRESP
    if kind == SUBSCRIBE:
        # Each filter is granted the quality that it asks for.
        number = body[:2]
        rest = body[2:]
        grants = b""
        while rest:
            _topic, rest = _text(rest)
            grants += rest[:1]
            rest = rest[1:]
        head = bytes((0x90, 2 + len(grants)))
        return head + number + grants
    if kind == PUBLISH and packet[0] & 0x06:
        _topic, rest = _text(body)
        return b"\x40\x02" + rest[:2]
    return b""


def _text(data: bytes) -> tuple[str, bytes]:
    """Return the text at the start of `data`, and what follows."""
    size = int.from_bytes(data[:2])
    end = 2 + size
    return data[2:end].decode(), data[end:]
