"""A fake device that sends and receives datagrams, such as a phone's sensor app or a network lamp."""

import asyncio
import socket
from typing import ClassVar

from pointit.testing.devices.device import NetworkDevice


class UdpDevice(NetworkDevice):
    """A sender to `program_port`, on which the program listens, and a receiver on `port`."""

    is_connected: ClassVar[bool] = False

    def __init__(self) -> None:
        super().__init__(socket.SOCK_DGRAM)
        self.program_port = 0
        """Port on which the program listens."""
        with self.take_program_port() as free:
            self.program_port = int(free.getsockname()[1])
        self.datagrams: list[bytes] = []
        """Datagrams received since it was plugged in. `received` has their bytes."""
        self._transport: asyncio.DatagramTransport | None = None

    def take_program_port(self) -> socket.socket:
        """Return a socket that has the program's port until it is closed, like that of another program."""
        taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        taken.bind((self.host, self.program_port))
        return taken

    async def plug(self) -> None:
        """Begin to send and receive."""
        self._reserved.close()
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(
            lambda: _Receiver(self), local_addr=(self.host, self.port)
        )

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
