"""A fake device that listens on a TCP port, such as a wrist or a lamp in the wireless network."""

import asyncio
import contextlib
import socket
from typing import ClassVar, cast

from pointit.testing.devices.device import NetworkDevice

LOST_AFTER_S = 1.0
READ_BYTES = 65536


class TcpDevice(NetworkDevice):
    """A server on a free port of this machine, which serves one program at a time."""

    can_stall: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__(socket.SOCK_STREAM)
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()

    async def plug(self) -> None:
        """Listen."""
        self._server = await asyncio.start_server(self._serve, self.host, self.port)

    async def unplug(self) -> None:
        """Close the port and reset all connections."""
        if self._server is None:
            return
        self._server.close()
        self._server = None
        for writer in self._writers:
            writer.transport.abort()
        self._writers.clear()
        self.received.clear()
        await asyncio.sleep(0)  # transports close in the next turn of the loop

    async def send(self, data: bytes) -> None:
        """Send to the connected program."""
        for writer in [*self._writers]:
            with contextlib.suppress(OSError):  # also TimeoutError
                writer.write(data)
                async with asyncio.timeout(LOST_AFTER_S):
                    await writer.drain()

    def stall(self) -> None:
        """Stop reading."""
        for writer in self._writers:
            cast("asyncio.Transport", writer.transport).pause_reading()

    def resume(self) -> None:
        """Read again."""
        for writer in self._writers:
            cast("asyncio.Transport", writer.transport).resume_reading()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.received.clear()
        self._writers.add(writer)
        with contextlib.suppress(OSError):
            while data := await reader.read(READ_BYTES):
                self.received.extend(data)
        self._writers.discard(writer)
        writer.close()
