"""Pseudo-terminals that stand for serial devices: one that talks, one that listens, both can be unplugged."""

import contextlib
import os
import select
import threading
import time
import tty
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
        master, slave, self.master, self._slave = self.master, self._slave, -1, -1
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


class Talker:
    """Sends a line at a rate, in a thread; the line may change at any time, the device may be replugged."""

    def __init__(self, device: PtyDevice, line: Callable[[], bytes], rate_hz: float = 100.0) -> None:
        self.device = device
        self.lock = threading.Lock()
        self._line = line
        self._period_s = 1.0 / rate_hz
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="pty talker", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        due_s = time.monotonic()
        while not self._stop.is_set():
            with self.lock:
                if self.device.plugged:
                    self.device.send(self._line())
            due_s += self._period_s
            self._stop.wait(max(0.0, due_s - time.monotonic()))


class Listener:
    """Reads all that the program sends, in a thread, as long as the device is plugged in."""

    def __init__(self, device: PtyDevice, take: Callable[[bytes], None]) -> None:
        self.device = device
        self.lock = threading.Lock()
        self._take = take
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="pty listener", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            with self.lock:
                data = self.device.receive(0.01) if self.device.plugged else b""
            if data:
                self._take(data)
            else:
                self._stop.wait(0.002)
