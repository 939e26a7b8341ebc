"""A serial device: read in its own thread, reconnected forever, watched for silence."""

import collections
import threading
import time

import serial
from pydantic import Field

from pointit.runtime.clock import Clock
from pointit.runtime.config.config import Config
from pointit.runtime.errors import ConfigError
from pointit.runtime.health.service_bus import WarningSink
from pointit.runtime.host.serial_port import PortSettings, SerialThread
from pointit.services.imu_bridge.reading import Deliver, Item, Press, Reading, Reconnected
from pointit.services.imu_bridge.sources import ImuSource
from pointit.services.imu_bridge.text_line import (
    ButtonLine,
    Fifth,
    LineError,
    LineParser,
    LineSplitter,
    Order,
)

CAPACITY = 1024
"""Readings buffered while the event loop is busy; the oldest are dropped."""

SHOWN_BYTES = 32
"""Number of first bytes in the warning about a device that sends nothing readable."""

CLEAR_BAD_AFTER_S = 10.0
"""Time without unreadable lines after which their warning is cleared."""


class SerialConfig(Config):
    """A device that sends lines of text."""

    port: str = Field(
        default="", description="path or name of the port; /dev/serial/by-id/... survives plugging in again"
    )
    baud: int = Field(default=115200, gt=0, le=4_000_000, description="bits per second")
    order: Order = Field(default="wxyz", description="order of the quaternion's numbers in a line")
    fifth: Fifth = Field(
        default="auto",
        description="meaning of a fifth number: a leading time in µs or a trailing accuracy; "
        "auto: a time if the first number is beyond ±1.1",
    )
    timeout_s: float = Field(
        default=3.0,
        gt=0,
        le=60,
        description="time without a readable line after which a connected device is a warning, s",
    )


class SerialSource:
    """Converts lines of text from a port to readings stamped with their arrival."""

    def __init__(self, config: SerialConfig, clock: Clock, warnings: WarningSink) -> None:
        self._config = config
        self._clock = clock
        self._warnings = warnings
        self._parser = LineParser(config.order, config.fifth)
        self._thread = SerialThread(
            PortSettings(port=config.port, baud=config.baud), self._read, self._on_change
        )
        self._ready: collections.deque[Item] = collections.deque(maxlen=CAPACITY)
        self._awake = False
        self._bad_s: float | None = None
        self._bad_reason = ""
        self._bad_reported = True
        self.bad_lines = 0
        """Number of unreadable lines since the start."""

    async def run(self, deliver: Deliver) -> None:
        """Deliver readings until cancelled."""
        self._deliver = deliver
        await self._thread.run()

    def _on_change(self, problem: str) -> None:
        self._warnings.warn("port", problem)
        if problem:
            self._warnings.clear("silent")

    def _read(self, port: serial.Serial, stopping: threading.Event) -> None:
        """Read until asked to stop; runs in the port's thread."""
        self._post(Reconnected())
        splitter = LineSplitter()
        watch = _SilenceWatch(self._config)
        while not stopping.is_set():
            data = port.read(max(1, port.in_waiting))
            stamp_ns = self._clock.now_ns()
            now_s = time.monotonic()
            good = 0
            overlong = splitter.overlong
            for line in splitter.feed(data):
                try:
                    good += self._take(line, stamp_ns)
                except LineError as error:
                    self._count_bad(1, f"{line[:40]!r} {error}", now_s)
            if splitter.overlong > overlong:
                self._count_bad(splitter.overlong - overlong, "a line without an end", now_s)
            if self._bad_s is not None and now_s - self._bad_s > CLEAR_BAD_AFTER_S:
                self._bad_s = None
                self._thread.post(self._warnings.clear, "lines")
            change = watch.step(data, good, now_s)
            if change is not None:
                self._thread.post(self._on_silence, change)

    def _take(self, line: bytes, stamp_ns: int) -> bool:
        """Pass `line` to the event loop. Return True if it contained a reading or a gesture."""
        parsed = self._parser.parse(line)
        if parsed is None:
            return False
        if isinstance(parsed, ButtonLine):
            self._post(Press(stamp_ns, parsed.gesture))
        else:
            self._post(Reading(stamp_ns, parsed.orientation_xyzw, parsed.device_time_ns))
        return True

    def _post(self, item: Item) -> None:
        """Pass `item` to the event loop for delivery; runs in the port's thread."""
        self._ready.append(item)
        if not self._awake:
            self._awake = True
            self._thread.post(self._drain)

    def _drain(self) -> None:
        self._awake = False  # first: later items wake the loop again
        while self._ready:
            self._deliver(self._ready.popleft())

    def _on_silence(self, message: str) -> None:
        self._warnings.warn("silent", message)

    def _count_bad(self, count: int, reason: str, now_s: float) -> None:
        self.bad_lines += count
        self._bad_s = now_s
        self._bad_reason = reason
        if self._bad_reported:  # limits calls while much garbage arrives
            self._bad_reported = False
            self._thread.post(self._warn_bad)

    def _warn_bad(self) -> None:
        self._bad_reported = True
        self._warnings.warn(
            "lines",
            f"{self.bad_lines} lines from {self._config.port} could not be read, the last: "
            f"{self._bad_reason}; a quaternion looks like `1.0,0.0,0.0,0.0`; check baud and order",
        )


class _SilenceWatch:
    """Detects a connected device that sends nothing readable."""

    def __init__(self, config: SerialConfig) -> None:
        self._config = config
        self._heard_s = time.monotonic()
        self._bytes = 0
        self._first = b""
        self._silent = False

    def step(self, data: bytes, good: int, now_s: float) -> str | None:
        """Return the warning when silence begins, `""` when it ends, else None."""
        self._bytes += len(data)
        if len(self._first) < SHOWN_BYTES:
            self._first = (self._first + data)[:SHOWN_BYTES]
        if good:
            self._heard_s = now_s
            if self._silent:
                self._silent = False
                return ""
        elif not self._silent and now_s - self._heard_s > self._config.timeout_s:
            self._silent = True
            return self._message()
        return None

    def _message(self) -> str:
        config = self._config
        where = f"{config.port} is connected but sent nothing readable for {config.timeout_s:g} s"
        if not self._bytes:
            return f"{where}, not one byte: check the cable and that the device sends"
        return (
            f"{where}: {self._bytes} bytes, the first {self._first.hex(' ')}; "
            f"check baud ({config.baud}) and that it sends lines of text"
        )


def _check(config: SerialConfig) -> None:
    if not config.port:
        raise ConfigError("serial.port: is missing; name the device's port, as in serial.port=/dev/ttyUSB0")


SERIAL = ImuSource(
    summary="a device that sends lines of text over a serial port",
    config=SerialConfig,
    make=lambda config, around: SerialSource(config, around.clock, around.health),
    check=_check,
    argument="port",
)
