"""Pseudo-terminals that stand for serial devices: one that talks, one that listens, both can be unplugged."""

import contextlib
import os
import select
import threading
import time
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Self


class PtyDevice:
    """A device's end of a pseudo-terminal; the program opens `path`, a symlink that survives replugging."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.master = -1
        self._slave = -1

    @property
    def plugged(self) -> bool:
        return self.master >= 0

    def plug(self) -> None:
        """Appear under `path`, as udev would link a device that was plugged in."""
        assert not self.plugged
        self.master, self._slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        fresh = self.path.with_suffix(".new")
        fresh.symlink_to(os.ttyname(self._slave))
        fresh.replace(self.path)

    def unplug(self) -> None:
        """Unplug the device. Readers and writers get the errors of a removed device."""
        self.path.unlink(missing_ok=True)
        master = self.master
        slave = self._slave
        self.master = -1
        self._slave = -1
        for end in (slave, master):
            if end >= 0:
                os.close(end)

    def send(self, data: bytes) -> None:
        """Send, or lose data that the program does not read in time, as a real wire does."""
        with contextlib.suppress(BlockingIOError):
            os.write(self.master, data)

    def receive(self, timeout_s: float = 0.05) -> bytes:
        ready, _, _ = select.select([self.master], [], [], timeout_s)
        return os.read(self.master, 65536) if ready else b""


@contextlib.contextmanager
def pty_device(path: Path) -> Generator[PtyDevice]:
    """Yield a plugged device at `path`."""
    device = PtyDevice(path)
    device.plug()
    try:
        yield device
    finally:
        device.unplug()


class _InThread(ABC):
    """Steps in a thread until the end of the block; the device may be replugged under the lock."""

    def __init__(self, device: PtyDevice) -> None:
        self.device = device
        self.lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"pty {type(self).__name__}", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            self._step()

    @abstractmethod
    def _step(self) -> None: ...


class Talker(_InThread):
    """Sends a line at a rate; the line may change at any time."""

    def __init__(self, device: PtyDevice, line: Callable[[], bytes], rate_hz: float = 100.0) -> None:
        super().__init__(device)
        self._line = line
        self._period_s = 1.0 / rate_hz
        self._due_s = 0.0

    def _step(self) -> None:
        with self.lock:
            if self.device.plugged:
                self.device.send(self._line())
        self._due_s = (self._due_s or time.monotonic()) + self._period_s
        self._stop.wait(max(0.0, self._due_s - time.monotonic()))


class Listener(_InThread):
    """Reads all that the program sends, as long as the device is plugged in."""

    def __init__(self, device: PtyDevice, take: Callable[[bytes], None]) -> None:
        super().__init__(device)
        self._take = take

    def _step(self) -> None:
        with self.lock:
            data = self.device.receive(0.01) if self.device.plugged else b""
        if data:
            self._take(data)
        else:
            self._stop.wait(0.002)
