"""Output to a controller on a serial port, at a rate that wire and board can carry."""

import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Self

import serial
from pydantic import Field, field_validator, model_validator

from pointit.runtime.config.config import Config
from pointit.runtime.host.serial_port import PortSettings, SerialThread
from pointit.runtime.service.plugin_guard import HealthSink
from pointit.services.led_driver.output.network_output import OutputHealth
from pointit.services.led_driver.outputs import FRAME_RATE, OutputConfig, Segment, validated_order

CHANNELS = 64
Board = Literal["v1", "v2", "v3"]
MAX_BAUD = 4_000_000
BITS_PER_BYTE = 10
"""Bits on the wire, with start and stop bit."""


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


class ChannelConfig(Config):
    """Connection of a strip to its controller."""

    channel: int = Field(ge=0, le=63, description="board number (0-7) times 8 plus port (0-7)")
    order: str = Field(
        default="GRB", description="order of the colours on the LEDs' wire: GRB, RGB, GRBW ..."
    )

    _order = field_validator("order")(validated_order)


class ExpanderConfig(SerialOutputConfig):
    """A serial LED expander (UPXL: ElectroMage, Pixelblaze)."""

    kind: str = Field(default="expander", description="kind of controller")
    baud: int = Field(default=2_000_000, gt=0, le=4_000_000, description="bits per second")
    board: Board = Field(
        default="v2", description="generation of the board: v1, v2, v3 drive 240, 800, 1600 pixels a channel"
    )
    channels: dict[str, ChannelConfig] = Field(
        default={},
        description="connections by strip id; strips in the map's order on channels 0, 1, 2 ... if empty. "
        "Parts of strips are in `segments`, whose `universe` is the channel",
    )

    @field_validator("segments")
    @classmethod
    def _equally_wide(cls, segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
        return segments  # in place of the base's: each channel may have a width of its own

    def strip_ids(self) -> frozenset[str]:
        """Return the ids of the strips that it shows, empty for all of the map."""
        return super().strip_ids() | self.channels.keys()

    @model_validator(mode="after")
    def _one_strip_a_channel(self) -> Self:
        if self.channels and self.segments:
            raise ValueError("use `channels` or `segments`, not both")
        if any(segment.universe not in range(CHANNELS) for segment in self.segments):
            raise ValueError(f"segments: each needs its channel, 0 to {CHANNELS - 1}, as `universe`")
        taken: dict[int, str] = {}
        for strip_id, channel in self.channels.items():
            other = taken.setdefault(channel.channel, strip_id)
            if other != strip_id:
                raise ValueError(
                    f"channels: strips {other!r} and {strip_id!r} share channel {channel.channel}"
                )
        return self


KEEP_ALIVE_S = 1.0
"""Period at which an unchanged frame is resent, s. A board that was plugged in or lost a frame recovers."""
PIECE_BYTES = 256
"""Size of one write. A link that accepts this within the port's timeout is slow, not stuck."""
SENT_FRAMES = 5
"""A link counts as slow if the fastest of this many frames was slow."""
SLOW_SHARE = 1.5
"""A link is slow if its frames take more than this many times their time by the baud rate."""
DRAIN_POLL_S = 0.002


@dataclass(frozen=True, kw_only=True)
class SerialFrame(ABC):
    """Content of a controller."""

    shown_s: float = field(default=0.0, compare=False)
    """Time at which it was passed to `show`, monotonic."""
    age_s: float = field(default=0.0, compare=False)
    """Age of what it shows at that time, s."""

    draws_while_receiving: ClassVar[bool]
    """True if the controller receives the next frame while it draws this one."""

    def opening(self) -> Self:
        """Return the frame to send first to a port that was opened."""
        return self

    @abstractmethod
    def dark(self) -> Self:
        """Return the same pixels, all black."""

    @abstractmethod
    def data(self) -> bytes:
        """Return the bytes of the protocol that show it."""

    @abstractmethod
    def draw_time_s(self) -> float:
        """Return the time that the controller takes to draw it, s."""


class SerialOutput:
    """Sends frames to one controller in a thread of its own. Newer frames replace unsent ones."""

    def __init__(self, config: SerialOutputConfig, health: HealthSink) -> None:
        self._config = config
        self._account = health
        self._health = OutputHealth(health, config.port)
        self._change = threading.Condition()
        self._newest: SerialFrame | None = None
        self._thread = SerialThread(
            PortSettings(port=config.port, baud=config.baud), self._write, self._on_port_change, self._wake
        )
        self._took_s = deque[float](maxlen=SENT_FRAMES)
        """Times that the last frames took to leave, s."""
        self._busy_s = deque[float](maxlen=SENT_FRAMES)
        """Times for which wire and board were busy with each of them, s."""
        self.light_s = 0.0
        """Time from `show` to the last byte on the wire, of the last new frame, s; 0.0 before the first."""

    def send(self, picture: SerialFrame) -> None:
        """Send `picture`. It replaces an unsent one."""
        with self._change:
            self._newest = picture
            self._change.notify()

    def set_problems(self, problems: list[str]) -> None:
        """Show what board and wire cannot show of the map's strips, which are new."""
        self._took_s.clear()
        self._busy_s.clear()
        self._health.warn("wiring", "; ".join(problems))

    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""
        await self._thread.run()

    def _wake(self) -> None:
        with self._change:
            self._change.notify()

    def _on_port_change(self, why: str) -> None:
        if why:
            self._account.warn("port", f"LED controller: {why}")
            self._took_s.clear()
            self._busy_s.clear()
            self.light_s = 0.0
            self._health.set_metric(FRAME_RATE, None)
            self._health.clear("link")
        else:
            self._health.clear("port")

    def _write(self, port: serial.Serial, stopping: threading.Event) -> None:
        frame: SerialFrame | None = None
        sent_s = 0.0
        while True:
            picture = self._next(frame, sent_s, stopping)
            if stopping.is_set():
                break
            if picture is None:
                continue
            if frame is None:
                # The board may be in the middle of an aborted frame, so that it discards this one.
                self._send(port, picture.opening())
            is_new = picture != frame
            frame = picture
            sent_s = time.monotonic()
            self._send(port, picture, is_new=is_new)
        if frame is not None:
            self._send(port, frame.dark())

    def _next(
        self, frame: SerialFrame | None, sent_s: float, stopping: threading.Event
    ) -> SerialFrame | None:
        """Wait for a picture other than `frame`, or until it is time to resend that one."""
        with self._change:
            while not stopping.is_set():
                newest = self._newest
                left_s = sent_s + KEEP_ALIVE_S - time.monotonic()
                if newest is not None and (newest != frame or left_s <= 0.0):
                    return newest
                self._change.wait(left_s if newest is not None else KEEP_ALIVE_S)
        return None

    def _send(self, port: serial.Serial, picture: SerialFrame, *, is_new: bool = False) -> None:
        """Write, and wait until wire and board are done: a buffer full of old frames would add latency."""
        began_s = time.monotonic()
        data = picture.data()
        for start in range(0, len(data), PIECE_BYTES):
            port.write(data[start : start + PIECE_BYTES])
        wire_s = wire_time_s(len(data), self._config.baud)
        time.sleep(max(0.0, began_s + wire_s - time.monotonic()))
        _drain(port)
        now_s = time.monotonic()
        self._thread.post(self._on_sent, picture, wire_s, now_s - began_s, now_s if is_new else None)
        drawn_s = (began_s if picture.draws_while_receiving else now_s) + picture.draw_time_s()
        time.sleep(max(0.0, drawn_s - time.monotonic()))

    def _on_sent(self, picture: SerialFrame, wire_s: float, took_s: float, new_s: float | None) -> None:
        """Count a frame whose last byte has left, at `new_s` if its picture is new."""
        if new_s is not None:
            self.light_s = new_s - picture.shown_s
            self._health.reached(picture.age_s + self.light_s)
        self._took_s.append(took_s)
        draw_s = picture.draw_time_s()
        self._busy_s.append(max(took_s, draw_s) if picture.draws_while_receiving else took_s + draw_s)
        # not the rate of sending: a static scene sends few frames
        self._health.set_metric(FRAME_RATE, len(self._busy_s) / sum(self._busy_s), "Hz")
        took_s = min(self._took_s)
        slow_s = max(SLOW_SHARE * wire_s, 1.0 / self._config.wanted_rate_hz)
        if took_s <= slow_s:
            self._health.clear("link")
        elif len(self._took_s) == SENT_FRAMES:
            self._health.warn(
                "link",
                f"takes {took_s * 1e3:.0f} ms a frame, {1.0 / took_s:.1f} frames a "
                f"second; at {self._config.baud} baud {wire_s * 1e3:.0f} ms would do: something slows the "
                "link (adapter, hub, flow control); use a faster one, or fewer pixels",
            )


def _drain(port: serial.Serial) -> None:
    """Wait until the written bytes have left, as long as there is progress.

    Raises:
        serial.SerialTimeoutException: If the port makes no progress.
    """
    waiting, since_s = port.out_waiting, time.monotonic()
    while waiting:
        time.sleep(DRAIN_POLL_S)
        left = port.out_waiting
        if left < waiting:
            waiting, since_s = left, time.monotonic()
        elif time.monotonic() - since_s > (port.write_timeout or 0.0):
            raise serial.SerialTimeoutException("nothing leaves the port")
