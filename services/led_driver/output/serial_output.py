"""Output to a controller on a serial port, at a rate that wire and board can carry.

No core: it waits for a serial port.
"""

import threading
import time
from abc import abstractmethod
from collections import deque
from dataclasses import dataclass, field, replace
from typing import ClassVar

import serial
from pydantic import Field

from pointit.runtime.host.serial_port import PortSettings, SerialThread
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.services.led_driver.output.pixel_output import PixelOutput
from pointit.services.led_driver.outputs import FRAME_RATE, OutputConfig

MAX_BAUD = 4_000_000
BITS_PER_BYTE = 10
"""Bits on the wire, with start and stop bit."""

KEEP_ALIVE_S = 1.0
"""Period at which an unchanged frame is resent, s. A board that was plugged in or lost a frame recovers."""
PIECE_BYTES = 256
"""Size of one write. A link that accepts this within the port's timeout is slow, not stuck."""
SENT_FRAMES = 5
"""A link counts as slow if the fastest of this many frames was slow."""
SLOW_SHARE = 1.5
"""A link is slow if its frames take more than this many times their time by the baud rate."""
DRAIN_POLL_S = 0.002


class SerialOutputConfig(OutputConfig):
    """A controller on a serial port."""

    port: str = Field(
        default="",
        description="path or name of the controller's port; /dev/serial/by-id/... survives plugging in again",
    )
    baud: int = Field(default=115200, gt=0, le=MAX_BAUD, description="bits per second")
    wanted_rate_hz: float = Field(
        default=25.0, gt=0, le=1000, description="frames per second below which a warning says what fits"
    )


def wire_time_s(size_bytes: int, baud: int) -> float:
    """Return the time until the last of `size_bytes` has left a wire of `baud` bits per second."""
    return size_bytes * BITS_PER_BYTE / baud


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialFrame:
    """Bytes that show pixels on a controller."""

    data: bytes
    opening: bytes
    """Bytes to send first to a port that was opened."""
    dark: bytes
    """Bytes that show the same pixels, all black."""
    draw_s: float
    """Time that the controller takes to draw it, s."""
    shown_s: float = field(default=0.0, compare=False)
    """Time at which it was passed to `show`, monotonic."""
    age_s: float = field(default=0.0, compare=False)
    """Age of what it shows at that time, s."""


class SerialOutput(PixelOutput):
    """Sends frames to one controller on a serial port. A subclass says which bytes show pixels."""

    DRAWS_WHILE_RECEIVING: ClassVar[bool] = False
    """True if the controller receives the next frame while it draws this one."""

    def __init__(self, config: SerialOutputConfig, surroundings: Surroundings) -> None:
        """Prepare; nothing is opened yet. Frames are written in a thread of the output's own."""
        super().__init__(config, surroundings, config.port)
        self._port = config
        self._port_health = surroundings.health
        self._change = threading.Condition()
        self._newest: SerialFrame | None = None
        self._thread = SerialThread(
            PortSettings(port=config.port, baud=config.baud), self._write, self._on_port_change, self._wake
        )
        self._took_s = deque[float](maxlen=SENT_FRAMES)
        """Times that the last frames took to leave, s."""
        self._busy_s = deque[float](maxlen=SENT_FRAMES)
        """Times for which wire and board were busy with each of them, s."""

    @abstractmethod
    def encode(self, pixels: bytes) -> bytes:
        """Return the bytes that show `pixels` of the present map, `b""` to send none."""

    def encode_opening(self, pixels: bytes) -> bytes:
        """Return the bytes to send before those of `pixels` to a port that was opened: a dark frame.

        The controller may be in the middle of an aborted frame, so that it discards this one; the rest of a
        dark one is no command of WLED, such as another rate.
        """
        return self.encode(bytes(len(pixels)))

    def draw_time_s(self) -> float:
        """Return the time that the controller takes to draw a frame of the present map, s."""
        return 0.0

    def send_pixels(self, pixels: bytes, age_s: float) -> None:
        """Send `pixels` of the present map, captured `age_s` ago, instead of unsent ones. Returns at once."""
        data = self.encode(pixels)
        if not data:
            return
        frame = SerialFrame(
            data=data,
            opening=self.encode_opening(pixels),
            dark=self.encode(bytes(len(pixels))),
            draw_s=self.draw_time_s(),
            shown_s=time.monotonic(),
            age_s=age_s,
        )
        with self._change:
            self._newest = frame
            self._change.notify()

    def _on_map(self, problems: list[str]) -> None:
        self._took_s.clear()
        self._busy_s.clear()
        self.health.warn("wiring", "; ".join(problems))

    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""
        await self._thread.run()

    def _wake(self) -> None:
        with self._change:
            self._change.notify()

    def _on_port_change(self, reason: str) -> None:
        """Report that the port is lost for a `reason`, or open if that is `""`."""
        if not reason:
            self._port_health.clear("port")
            return

        # The times of the last frames say nothing about the next connection
        self._port_health.warn("port", f"LED controller: {reason}")
        self._took_s.clear()
        self._busy_s.clear()
        self.health.light_s = 0.0
        self.health.set_metric(FRAME_RATE, None)
        self.health.clear("link")

    def _write(self, port: serial.Serial, stopping: threading.Event) -> None:
        """Write frames to an open port until `stopping` is set, then a dark one."""
        shown: SerialFrame | None = None
        sent_s = 0.0
        while True:
            frame = self._next_frame(shown, sent_s, stopping)
            if stopping.is_set():
                break
            if frame is None:
                continue
            if shown is None:
                self._transmit(port, replace(frame, data=frame.opening))
            is_new = frame != shown
            shown = frame
            sent_s = time.monotonic()
            self._transmit(port, frame, is_new=is_new)
        if shown is not None:
            self._transmit(port, replace(shown, data=shown.dark))

    def _next_frame(
        self, shown: SerialFrame | None, sent_s: float, stopping: threading.Event
    ) -> SerialFrame | None:
        """Wait for a frame other than the `shown` one, or until it is time to resend that one."""
        with self._change:
            while not stopping.is_set():
                newest = self._newest
                if newest is None:
                    self._change.wait(KEEP_ALIVE_S)
                    continue
                remaining_s = sent_s + KEEP_ALIVE_S - time.monotonic()
                if newest != shown or remaining_s <= 0.0:
                    return newest
                self._change.wait(remaining_s)
        return None

    def _transmit(self, port: serial.Serial, picture: SerialFrame, *, is_new: bool = False) -> None:
        """Write, and wait until wire and board are done: a buffer full of old frames would add latency."""
        began_s = time.monotonic()
        data = picture.data
        for start in range(0, len(data), PIECE_BYTES):
            port.write(data[start : start + PIECE_BYTES])

        # First the time that the wire needs by its baud rate, then for what the driver still holds
        wire_s = wire_time_s(len(data), self._port.baud)
        remaining_s = began_s + wire_s - time.monotonic()
        time.sleep(max(0.0, remaining_s))
        _drain(port)
        now_s = time.monotonic()
        new_s = now_s if is_new else None
        took_s = now_s - began_s
        self._thread.post(self._on_sent, picture, wire_s, took_s, new_s)

        # The next frame must not come before the board has drawn this one
        draw_start_s = began_s if self.DRAWS_WHILE_RECEIVING else now_s
        drawn_s = draw_start_s + picture.draw_s
        time.sleep(max(0.0, drawn_s - time.monotonic()))

    def _on_sent(self, picture: SerialFrame, wire_s: float, took_s: float, new_s: float | None) -> None:
        """Count a frame whose last byte has left, at `new_s` if its picture is new."""
        if new_s is not None:
            self.health.reached(picture.age_s, new_s - picture.shown_s)
        self._took_s.append(took_s)
        busy_s = took_s + picture.draw_s
        if self.DRAWS_WHILE_RECEIVING:
            busy_s = max(took_s, picture.draw_s)
        self._busy_s.append(busy_s)
        # not the rate of sending: a static scene sends few frames
        rate_hz = len(self._busy_s) / sum(self._busy_s)
        self.health.set_metric(FRAME_RATE, rate_hz, "Hz")

        # The fastest of several frames: the others may have been held up by more than the link
        fastest_s = min(self._took_s)
        slow_s = max(SLOW_SHARE * wire_s, 1.0 / self._port.wanted_rate_hz)
        if fastest_s <= slow_s:
            self.health.clear("link")
        elif len(self._took_s) == SENT_FRAMES:
            self._warn_of_slow_link(fastest_s, wire_s)

    def _warn_of_slow_link(self, took_s: float, wire_s: float) -> None:
        took_ms = took_s * 1e3
        wire_ms = wire_s * 1e3
        rate_hz = 1.0 / took_s
        self.health.warn(
            "link",
            f"takes {took_ms:.0f} ms a frame, {rate_hz:.1f} frames a "
            f"second; at {self._port.baud} baud {wire_ms:.0f} ms would do: something slows the "
            "link (adapter, hub, flow control); use a faster one, or fewer pixels",
        )


def _drain(port: serial.Serial) -> None:
    """Wait until the written bytes have left, as long as there is progress.

    Raises:
        serial.SerialTimeoutException: If the port makes no progress.
    """
    waiting_bytes = port.out_waiting
    progress_s = time.monotonic()
    while waiting_bytes:
        time.sleep(DRAIN_POLL_S)
        remaining_bytes = port.out_waiting
        if remaining_bytes < waiting_bytes:
            waiting_bytes = remaining_bytes
            progress_s = time.monotonic()
        elif time.monotonic() - progress_s > (port.write_timeout or 0.0):
            raise serial.SerialTimeoutException("nothing leaves the port")
