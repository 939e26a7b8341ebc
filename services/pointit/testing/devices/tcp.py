"""A fake device that listens on a TCP port, such as a wrist or a lamp in the wireless network."""

import asyncio
import contextlib
import socket
from typing import ClassVar

from pointit.testing.devices.device import FakeDevice, ReservedPort

LOST_AFTER_S = 1.0


class TcpDevice(FakeDevice):
    """A server on a free port of this machine, which serves one program at a time."""

    can_stall: ClassVar[bool] = True
    host = "127.0.0.1"

    def __init__(self) -> None:
        super().__init__()
        self._reserved = ReservedPort(socket.SOCK_STREAM)
        self.port = self._reserved.number
        """Port that the program connects to."""
        self._server: asyncio.Server | None = None
        self._transports: list[asyncio.Transport] = []
        self._may_write = asyncio.Event()
        self._may_write.set()

    async def plug(self) -> None:
        """Listen."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Connection(self), self.host, self.port)

    async def unplug(self) -> None:
        """Close the port and reset all connections."""
        if self._server is None:
            return
        self._server.close()
        self._server = None
        for transport in self._transports:
            transport.abort()
        self._transports.clear()
        self.received.clear()
        self._may_write.set()
        await asyncio.sleep(0)  # transports close in the next turn of the loop

    async def send(self, data: bytes) -> None:
        """Send to the connected program."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LOST_AFTER_S):
                await self._may_write.wait()
        for transport in self._transports:
            transport.write(data)

    def stall(self) -> None:
        """Stop reading."""
        for transport in self._transports:
            transport.pause_reading()

    def resume(self) -> None:
        """Read again."""
        for transport in self._transports:
            transport.resume_reading()

    def close(self) -> None:
        """Free the port."""
        self._reserved.close()

    def connected(self, transport: asyncio.Transport) -> None:
        """Take a new connection."""
        self.received.clear()
        self._transports.append(transport)

    def disconnected(self, transport: asyncio.Transport) -> None:
        """Forget a connection."""
        if transport in self._transports:
            self._transports.remove(transport)
        self._may_write.set()

    def set_writable(self, *, writable: bool) -> None:
        """Remember whether the program takes more bytes."""
        (self._may_write.set if writable else self._may_write.clear)()


class _Connection(asyncio.Protocol):
    def __init__(self, device: TcpDevice) -> None:
        self._device = device
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - what a TCP server gives
        self._transport = transport
        self._device.connected(transport)

    def data_received(self, data: bytes) -> None:
        self._device.received.extend(data)

    def pause_writing(self) -> None:
        self._device.set_writable(writable=False)

    def resume_writing(self) -> None:
        self._device.set_writable(writable=True)

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        if self._transport is not None:
            self._device.disconnected(self._transport)
