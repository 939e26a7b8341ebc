"""An encoder of NatNet for tests, checked against the packets of others, and a server on sockets."""

import asyncio
import contextlib
import socket
import struct
from collections.abc import AsyncGenerator, Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

CLOCK_HZ = 10_000_000
FRAME = 7
INFO = 1
MODELS = 5
ECHO = 13


@dataclass
class Body:
    """A rigid body in a frame."""

    id: int
    position: tuple[float, float, float] = (1.0, 1.5, -2.0)
    turn: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    error: float = 0.0004
    tracked: bool = True
    markers: tuple[int, ...] = ()
    """Flags of its labelled markers."""


def packet(message: int, payload: bytes) -> bytes:
    return struct.pack("<HH", message, len(payload)) + payload


def info(
    version: tuple[int, int] = (3, 1), *, multicast: bool = False, clock_hz: int = CLOCK_HZ, port: int = 1511
) -> bytes:
    payload = struct.pack("<256s4B4B", b"Motive", 3, 0, 0, 0, *version, 0, 0)
    if version >= (3, 0):
        payload += struct.pack("<QHB4s", clock_hz, port, multicast, bytes((239, 255, 42, 99)))
    return packet(INFO, payload)


def _section(items: Sequence[bytes], version: tuple[int, int]) -> bytes:
    content = b"".join(items)
    size = struct.pack("<i", len(content)) if version >= (4, 1) else b""
    return struct.pack("<i", len(items)) + size + content


def frame(
    bodies: Sequence[Body],
    version: tuple[int, int] = (3, 1),
    *,
    number: int = 1,
    exposure: int = 0,
    sent: int = 0,
    flags: int = 0,
) -> bytes:
    def body(each: Body) -> bytes:
        data = struct.pack("<i3f4f", each.id, *each.position, *each.turn)
        if version < (3, 0):
            data += struct.pack("<i", 0)
        data += struct.pack("<f", each.error)
        return data + (struct.pack("<H", each.tracked) if version >= (2, 6) else b"")

    markers = [
        struct.pack("<i4fH", each.id << 16 | index, *each.position, 0.01, flag)
        + (struct.pack("<f", 0.0) if version >= (3, 0) else b"")
        for each in bodies
        for index, flag in enumerate(each.markers, start=1)
    ]
    data = struct.pack("<i", number) + _section((), version) * 2
    data += _section([body(each) for each in bodies], version)
    data += _section((), version) * ((version >= (2, 1)) + (version >= (4, 1)))
    data += _section(markers, version) if version >= (2, 3) else b""
    data += _section((), version) * ((version >= (2, 9)) + (version >= (2, 11)))
    if version >= (3, 0):
        data += struct.pack("<IIdQQQ", 0, 0, 0.0, exposure, exposure, sent or exposure)
        data += struct.pack("<II", 0, 0) if version >= (4, 1) else b""
    else:
        data += struct.pack("<IId", 0, 0, 0.0)
    return packet(FRAME, data + struct.pack("<Hi", flags, 0))


def models(names: dict[int, str], version: tuple[int, int] = (3, 1)) -> bytes:
    items: list[bytes] = []
    for number, name in names.items():
        content = name.encode() + b"\0" + struct.pack("<ii3f", number, -1, 0, 0, 0)
        content += struct.pack("<i", 0) if version >= (3, 0) else b""
        size = struct.pack("<i", len(content)) if version >= (4, 1) else b""
        items.append(struct.pack("<i", 1) + size + content)
    return packet(MODELS, struct.pack("<i", len(items)) + b"".join(items))


def echo(request: bytes, ticks: int) -> bytes:
    return packet(ECHO, request[4:12] + struct.pack("<Q", ticks))


@dataclass
class Server(asyncio.DatagramProtocol):
    """Answers requests, and streams to who has connected."""

    version: tuple[int, int]
    names: dict[int, str]
    now_ns: Callable[[], int]
    bodies: Callable[[int], Sequence[Body]]
    multicast: str = ""
    """Address of the interface by which it sends to the group, or `""` for unicast."""
    ahead_ns: int = 5 * 10**15
    """Time of its clock before that of `now_ns`."""
    clients: set[tuple[str, int]] = field(default_factory=set[tuple[str, int]])
    requests: list[int] = field(default_factory=list[int])
    data_port: int = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport

    def ticks(self, now_ns: int) -> int:
        return (now_ns + self.ahead_ns) * CLOCK_HZ // 10**9

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        (message,) = struct.unpack_from("<H", data)
        self.requests.append(message)
        if message in (0, 14):
            self.clients |= {addr} if message == 0 else set()
            reply = info(self.version, multicast=bool(self.multicast), port=self.data_port)
            self.transport.sendto(reply, addr)
        elif message == 4:
            self.transport.sendto(models(self.names, self.version), addr)
        elif message == 12:
            self.transport.sendto(echo(data, self.ticks(self.now_ns())), addr)

    async def stream(self, period_s: float = 0.01) -> None:
        number = 0
        while True:
            await asyncio.sleep(period_s)
            number += 1
            now_ns = self.now_ns()
            data = frame(self.bodies(now_ns), self.version, number=number, exposure=self.ticks(now_ns))
            targets = {("239.255.42.99", self.data_port)} if self.multicast else self.clients
            for target in targets:
                self.transport.sendto(data, target)


@contextlib.asynccontextmanager
async def serving(server: Server, host: str = "127.0.0.1") -> AsyncGenerator[int]:
    """Run a server at a free port. Yield the port."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind((host, 0))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((host, 0))
        server.data_port = int(free.getsockname()[1])
    if server.multicast:
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(server.multicast))
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: server, sock=sock)
    task = asyncio.create_task(server.stream())
    try:
        yield int(sock.getsockname()[1])
    finally:
        task.cancel()
        await asyncio.wait({task})
        transport.close()
