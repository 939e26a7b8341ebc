"""Serial ports: exclusive opening, a thread that keeps one open, and error messages."""

import asyncio
import contextlib
import errno
import logging
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import serial
from serial.tools import list_ports

from pointit.runtime.machine import this_machine

log = logging.getLogger(__name__)

Work = Callable[[serial.Serial, threading.Event], None]
"""Uses an open port until the event is set; raises `OSError` when the port is lost."""

RETRY_FIRST_S = 0.2
MAX_RETRY_S = 2.0
"""Delays between attempts to open a port, s: the first one, doubled up to the second one."""
END_WITHIN_S = 0.5
"""Time to wait for the end of a port's thread."""


@dataclass(frozen=True, kw_only=True)
class PortSettings:
    """Device, speed and time-out of blocking calls of a port."""

    port: str
    """Path or name; `/dev/serial/by-id/...` stays the same when a device is plugged in again."""
    baud: int
    read_timeout_s: float = 0.1
    write_timeout_s: float = 0.4


def open_port(settings: PortSettings) -> serial.Serial:
    """Return the open port, locked so that no other program steals its bytes.

    Raises:
        OSError: If it cannot be opened. `describe_error` gives the reason and the remedy.
    """
    try:
        return serial.Serial(
            settings.port,
            settings.baud,
            timeout=settings.read_timeout_s,
            write_timeout=settings.write_timeout_s,
            exclusive=True,
        )
    except OSError:
        raise
    except Exception as error:  # termios.error of a port that vanishes meanwhile, ValueError of its baud rate
        raise OSError(_errno_of(error) or errno.EINVAL, str(error)) from error


def describe_error(error: BaseException, port: str) -> str:
    """Return the meaning of `error` on `port` and the remedy, for a person."""
    number = _errno_of(error)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return f"{port} is not there: plug the device in; ports found: {describe_ports()}"
    if number in (errno.EACCES, errno.EPERM):
        return (
            f"{port} may not be opened: join the group `dialout` (Debian, Ubuntu) or `uucp` (Arch), "
            "`sudo usermod -aG dialout $USER`, then log out and in; a container needs `--device`"
        )
    if number in (errno.EBUSY, errno.EAGAIN):
        return f"{port} is held by another program (serial monitor, ModemManager, a second PointIt): end it"
    if number in (errno.ENOTTY, errno.EINVAL, errno.EISDIR):
        return f"{port} is not a serial port, or does not do this baud rate; ports found: {describe_ports()}"
    if isinstance(error, serial.SerialTimeoutException):
        return f"{port} takes no more data: check cable, baud rate and flow control"
    if number == errno.EIO or "returned no data" in str(error):
        return f"{port} went away: plug the device in again"
    return f"{port} failed ({error}): check the device and its cable"


@dataclass(frozen=True)
class SerialPort:
    """A serial port of this machine."""

    path: str
    """Its name that lasts, `/dev/serial/by-id/...`, or the device if there is none."""
    description: str
    """Name of the connected device."""


def serial_ports() -> list[SerialPort]:
    """Return the serial ports of this machine that have a device."""
    links = Path("/dev/serial/by-id").glob("*")
    lasting = {os.path.realpath(link): str(link) for link in links}
    ports: list[SerialPort] = []
    for info in sorted(list_ports.comports(), key=lambda info: info.device):
        if info.description == "n/a":  # the built-in ports that a board may or may not have
            continue
        path = lasting.get(info.device, info.device)
        ports.append(SerialPort(path, info.description))
    return ports


def describe_ports() -> str:
    """Return the serial ports of this machine and their devices as text, or `none`."""
    ports = [f"{port.path} ({port.description})" for port in serial_ports()]
    return ", ".join(ports) or "none"


def is_open_in_another_process(path: str) -> bool:
    """Return True if another process of this user has the port open (Linux; elsewhere always False)."""
    device = os.path.realpath(path)
    own = str(this_machine().process_id)
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):  # the process may have ended
            is_other_process = link.parts[2] != own
            if is_other_process and str(link.readlink()) == device:
                return True
    return False


class SerialThread:
    """Keeps one port open in a separate thread, which runs `work` with it.

    The port is opened again for ever, by its name, so a device that was plugged in again is found.
    """

    def __init__(
        self,
        settings: PortSettings,
        work: Work,
        on_change: Callable[[str], None],
        wake: Callable[[], None] = lambda: None,
    ) -> None:
        """Prepare; nothing is opened yet.

        `on_change` is called in the loop, with the reason if the port is down, or with `""` when it is up;
        `wake` when `work` is asked to end, for a `work` that waits for something else.
        """
        self._settings = settings
        self._work = work
        self._on_change = on_change
        self._wake = wake
        self._stopping = threading.Event()
        self._reported = ""
        self._ever_up = False

    async def run(self) -> None:
        """Run until cancelled. The thread has ended afterwards. An error of `work` is raised here."""
        self._loop = asyncio.get_running_loop()
        self._fault: asyncio.Future[None] = self._loop.create_future()
        thread = threading.Thread(target=self._run, name=f"serial {self._settings.port}", daemon=True)
        thread.start()
        try:
            await self._fault
        finally:
            self._stopping.set()
            self._wake()
            await asyncio.to_thread(thread.join, END_WITHIN_S)

    def post(self, call: Callable[..., None], *arguments: object) -> None:
        """Schedule `call(*arguments)` in the loop, from the port's thread."""
        try:
            self._loop.call_soon_threadsafe(call, *arguments)
        except RuntimeError:  # the loop is gone
            self._stopping.set()

    def _run(self) -> None:
        wait_s = RETRY_FIRST_S
        while not self._stopping.is_set():
            began_s = time.monotonic()
            try:
                with open_port(self._settings) as port:
                    self._report_state("")
                    self._work(port, self._stopping)
            except OSError as error:  # SerialException is one
                if not self._stopping.is_set():
                    self._report_state(describe_error(error, self._settings.port))
            except Exception as error:  # noqa: BLE001 - raised by `run`
                self.post(self._fail, error)
                return
            # The delay bounds the attempts at a port that opens and fails at once.
            wait_s = RETRY_FIRST_S if time.monotonic() - began_s > MAX_RETRY_S else wait_s
            self._stopping.wait(wait_s)
            wait_s = min(2.0 * wait_s, MAX_RETRY_S)

    def _report_state(self, problem: str) -> None:
        """Log each change to down and to up. Report every change of the reason to the loop."""
        port = self._settings.port
        if problem and not self._reported:
            log.warning("%s; trying again until it works", problem)
        elif not problem and self._reported:
            log.info("%s is %s", port, "back" if self._ever_up else "open")
        elif not problem:
            log.debug("%s is open at %d baud", port, self._settings.baud)
        self._ever_up = self._ever_up or not problem
        if problem != self._reported or not problem:
            self._reported = problem
            self.post(self._on_change, problem)

    def _fail(self, error: Exception) -> None:
        if not self._fault.done():
            self._fault.set_exception(error)


def _errno_of(error: BaseException) -> int | None:
    """Return the number of `error` or of its cause, since pyserial does not always keep it."""
    current: BaseException | None = error
    while current is not None:
        number = getattr(current, "errno", None)
        if isinstance(number, int):
            return number
        # termios.error has no `errno`
        first_argument = current.args[0] if current.args else None
        if isinstance(first_argument, int):
            return first_argument
        current = current.__cause__ or current.__context__
    return None
