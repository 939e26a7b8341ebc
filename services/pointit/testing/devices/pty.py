"""A fake serial device: the far end of a pseudo-terminal."""

import asyncio
import os
import tty
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

from pointit.testing.devices.device import FakeDevice

LOST_AFTER_S = 1.0
WAIT_S = 0.001
READ_BYTES = 65536


class PtyDevice(FakeDevice):
    """A pseudo-terminal; the program opens `path`, which stays the same when it is plugged in again."""

    can_stall: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__()
        self._folder = TemporaryDirectory()
        self.path = Path(self._folder.name) / "port"
        """Path of the port that the program opens."""
        self._device = -1
        self._program = -1

    async def plug(self) -> None:
        """Appear under `path`, as udev would link a device that was plugged in."""
        self.received.clear()
        self._device, self._program = os.openpty()
        for end in (self._device, self._program):
            tty.setraw(end)
        os.set_blocking(self._device, False)
        self.resume()
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
        while rest and self._device >= 0 and loop.time() < end_s:
            try:
                rest = rest[os.write(self._device, rest) :]
                end_s = loop.time() + LOST_AFTER_S
            except BlockingIOError:
                await asyncio.sleep(WAIT_S)

    def stall(self) -> None:
        """Stop reading."""
        asyncio.get_running_loop().remove_reader(self._device)

    def resume(self) -> None:
        """Read again."""
        asyncio.get_running_loop().add_reader(self._device, self._read)

    def close(self) -> None:
        """Remove the folder of the link."""
        self._folder.cleanup()

    def _read(self) -> None:
        self.received.extend(os.read(self._device, READ_BYTES))
