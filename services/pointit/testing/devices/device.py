"""The device's side of a link, as checks use it."""

import socket
from typing import ClassVar


class FakeDevice:
    """A device that can appear, vanish, send and receive. This one is none: for plug-ins without a device.

    Every method runs in the event loop of the plug-in.
    """

    is_connected: ClassVar[bool] = True
    """False if the program cannot notice that the device vanishes, as with UDP."""
    can_stall: ClassVar[bool] = False
    """True if `stall` stops a program that sends more than the device reads."""

    def __init__(self) -> None:
        self.received = bytearray()
        """Bytes from the program since it last connected."""

    async def plug(self) -> None:
        """Appear: from now on the program can connect."""

    async def unplug(self) -> None:
        """Vanish, as if the cable was pulled. Does nothing if it is not there."""

    async def send(self, data: bytes) -> None:
        """Send `data`. What the program does not read within a second is lost, as on a real wire."""

    def stall(self) -> None:
        """Stop reading, and go on being connected."""

    def resume(self) -> None:
        """Read again."""

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

    def close(self) -> None:
        """Free the port."""
        self._reserved.close()
