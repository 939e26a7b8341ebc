"""Devices in software, for the tests of a plug-in: on a serial port, and in the network by TCP and UDP."""

import asyncio
import contextlib
import os
import random
import socket
import tty
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar, cast

LOST_AFTER_S = 1.0
WAIT_S = 0.001
READ_BYTES = 65536
PROGRAM_PORTS = range(10_000, 15_000)
"""Ports on which programs listen in tests, below those that Linux, macOS and Windows give out themselves."""


class FakeDevice:
    """A device that can appear, vanish, send and receive. This one is none: for plug-ins without a device.

    Every method runs in the event loop of the plug-in.
    """

    is_connected: ClassVar[bool] = True
    """False if the program cannot notice that the device vanishes, as with UDP."""
    can_stall: ClassVar[bool] = False
    """True if `stall` stops a program that sends more than the device reads."""

    def __init__(self) -> None:
        self.address: Mapping[str, object] = {}
        """Parameters that lead a program to it, such as `host` and `port`."""
        self.received = bytearray()
        """Bytes from the program since it last connected."""

    async def plug(self) -> None:
        """Appear: from now on the program can connect."""

    async def unplug(self) -> None:
        """Vanish, as if the cable was pulled. Does nothing if it is not there."""

    async def send(self, data: bytes) -> None:
        """Send `data`. Bytes that the program does not read within a second are lost, as on a real wire."""

    def stall(self) -> None:
        """Stop reading, and go on being connected."""

    def close(self) -> None:
        """Free what was reserved for it, at the end."""


class NetworkDevice(FakeDevice):
    """A device on a port of this machine, which stays its own while nothing listens there."""

    host = "127.0.0.1"

    def __init__(self, kind: socket.SocketKind) -> None:
        super().__init__()
        self._reserved = socket.socket(socket.AF_INET, kind)
        self._reserved.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._reserved.bind((self.host, 0))
        self.port: int = self._reserved.getsockname()[1]
        """Port of the device."""
        self.address = {"host": self.host, "port": self.port}

    def close(self) -> None:
        """Free the port."""
        self._reserved.close()


class PtyDevice(FakeDevice):
    """A serial device on a pseudo-terminal. Its `path` stays the same after it was unplugged."""

    can_stall: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__()
        self._folder = TemporaryDirectory()
        self.path = Path(self._folder.name) / "port"
        """Path of the port that the program opens."""
        self.address = {"port": str(self.path)}
        self._device = -1
        self._program = -1

    async def plug(self) -> None:
        """Appear under `path`, as udev would link a device that was plugged in."""
        self.received.clear()
        self._device, self._program = os.openpty()
        for end in (self._device, self._program):
            tty.setraw(end)
        os.set_blocking(self._device, False)
        asyncio.get_running_loop().add_reader(self._device, self._read)
        # The rename replaces the link at once, so that the program never finds half of it
        fresh = self.path.with_suffix(".new")
        fresh.symlink_to(os.ttyname(self._program))
        fresh.replace(self.path)

    async def unplug(self) -> None:
        """Vanish. The program gets the errors of a removed device."""
        if self._device < 0:
            return
        self.path.unlink(missing_ok=True)
        self.stall()
        for end in (self._program, self._device):
            os.close(end)
        self._device = self._program = -1
        self.received.clear()

    async def send(self, data: bytes) -> None:
        """Send as fast as the program reads."""
        loop = asyncio.get_running_loop()
        end_s = loop.time() + LOST_AFTER_S
        rest = memoryview(data)
        while rest and self._device >= 0:
            if loop.time() >= end_s:
                break
            try:
                rest = rest[os.write(self._device, rest) :]
                end_s = loop.time() + LOST_AFTER_S
            except BlockingIOError:
                await asyncio.sleep(WAIT_S)

    def stall(self) -> None:
        """Stop reading."""
        asyncio.get_running_loop().remove_reader(self._device)

    def close(self) -> None:
        """Remove the folder of the link."""
        self._folder.cleanup()

    def _read(self) -> None:
        self.received.extend(os.read(self._device, READ_BYTES))


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
        # abort, not close: the program must see a reset, not an orderly end
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

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.received.clear()
        self._writers.add(writer)
        with contextlib.suppress(OSError):
            while data := await reader.read(READ_BYTES):
                self.received.extend(data)
        self._writers.discard(writer)
        writer.close()


class UdpDevice(NetworkDevice):
    """A sender to `program_port`, on which the program listens, and a receiver on `port`."""

    is_connected: ClassVar[bool] = False

    def __init__(self) -> None:
        super().__init__(socket.SOCK_DGRAM)
        self._numbered = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.program_port = self._unused_port()
        """Port on which the program listens."""
        self.datagrams: list[bytes] = []
        """Datagrams received since it was plugged in. `received` has their bytes."""
        self._transport: asyncio.DatagramTransport | None = None

    def take_program_port(self) -> socket.socket:
        """Return a socket that has the program's port until it is closed, like that of another program."""
        program_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        program_socket.bind((self.host, self.program_port))
        return program_socket

    def _unused_port(self) -> int:
        """Return a port that stays free until the program opens it: systems assign none of `PROGRAM_PORTS`.

        The TCP port of that number is kept open, which reserves it among the devices of all processes.

        Raises:
            OSError: If all are in use.
        """
        for port in random.SystemRandom().sample(PROGRAM_PORTS, len(PROGRAM_PORTS)):
            with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((self.host, port))
                self._numbered.bind((self.host, port))
                return port
        last_port = PROGRAM_PORTS.stop - 1
        raise OSError(f"no port of {PROGRAM_PORTS.start} to {last_port} is free")

    def close(self) -> None:
        """Free both ports."""
        super().close()
        self._numbered.close()

    async def plug(self) -> None:
        """Start to send and receive."""
        self._reserved.close()
        loop = asyncio.get_running_loop()
        address = (self.host, self.port)
        self._transport, _ = await loop.create_datagram_endpoint(lambda: _Receiver(self), local_addr=address)

    async def unplug(self) -> None:
        """Fall silent and receive nothing."""
        if self._transport is not None:
            self._transport.abort()
            self._transport = None
            self.received.clear()
            self.datagrams.clear()
            await asyncio.sleep(0)

    async def send(self, data: bytes) -> None:
        """Send one datagram."""
        if self._transport is not None:
            self._transport.sendto(data, (self.host, self.program_port))


class _Receiver(asyncio.DatagramProtocol):
    def __init__(self, device: UdpDevice) -> None:
        self._device = device

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        del addr
        self._device.datagrams.append(data)
        self._device.received.extend(data)
