"""Output to a serial LED expander: the newest frame, at a rate that wire and board can carry."""

import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import serial

from pointit.runtime.health.surroundings import HealthSink
from pointit.runtime.host.serial_port import PortSettings, SerialThread
from pointit.schemas import Strip, StripsFrame
from pointit.services.led_driver.output import upxl_protocol
from pointit.services.led_driver.output.expander_config import ExpanderConfig
from pointit.services.led_driver.output.power import Load, Power
from pointit.services.led_driver.output.wiring import FRAME_RATE, Wiring, map_channels, too_slow, wire_time_s
from pointit.services.led_driver.outputs import LedOutput

log = logging.getLogger(__name__)

KEEP_ALIVE_S = 1.0
"""Period at which an unchanged frame is resent, s. A board that was plugged in or lost a frame recovers."""

LIMIT_SHOWN_S = 2.0
"""Time for which dimming is reported, s. Health is read once a second."""

FIGURE_NAME = 50
"""Maximum number of characters of the port's name in the name of its metric."""

PIECE_BYTES = 256
"""Size of one write. A link that accepts this within the port's timeout is slow, not stuck."""

SENT_FRAMES = 5
"""A link counts as slow if the fastest of this many frames was slow."""

SLOW_SHARE = 1.5
"""A link is slow if its frames take more than this many times their time by the baud rate."""

DRAIN_POLL_S = 0.002


@dataclass(frozen=True, slots=True)
class ExpanderFrame:
    """Content of the board: (channel, order, rgb) of each strip."""

    channels: tuple[tuple[int, str, bytes], ...] = ()
    shown_s: float = field(default=0.0, compare=False)
    """Time at which it was passed to `show`, monotonic."""
    age_s: float = field(default=0.0, compare=False)
    """Age of what it shows at that time, s."""

    def dark(self) -> "ExpanderFrame":
        """Return the same channels, all black."""
        return ExpanderFrame(
            tuple((channel, order, bytes(len(rgb))) for channel, order, rgb in self.channels)
        )

    def data(self) -> bytes:
        """Return the bytes of the protocol that show it."""
        return (
            b"".join(upxl_protocol.set_channel(*channel) for channel in self.channels)
            + upxl_protocol.draw_all()
        )

    def draw_time_s(self) -> float:
        """Return the time that the board takes to draw it, s."""
        return upxl_protocol.draw_time_s(max((len(rgb) // 3 for _, _, rgb in self.channels), default=0))


class ExpanderOutput:
    """Sends frames to one expander in a thread of its own. Newer frames replace unsent ones."""

    def __init__(self, config: ExpanderConfig, account: HealthSink) -> None:
        self._config = config
        self._account = account
        self._power = Power(config)
        self._limited_s = -LIMIT_SHOWN_S
        self._wirings: tuple[Wiring, ...] = ()
        self._change = threading.Condition()
        self._newest: ExpanderFrame | None = None
        self._thread = SerialThread(
            PortSettings(port=config.port, baud=config.baud), self._write, self._on_port_change, self._wake
        )
        self._took_s = deque[float](maxlen=SENT_FRAMES)
        """Times that the last frames took to leave, s."""
        self._busy_s = deque[float](maxlen=SENT_FRAMES)
        """Times for which wire and board were busy with each of them, s."""
        self.light_s = 0.0
        """Time from `show` to the last byte on the wire, of the last new frame, s; 0.0 before the first."""

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the map's strips. Reports in health what board and wire cannot show."""
        self._wirings, problems = map_channels(self._config, strips)
        self._took_s.clear()
        self._busy_s.clear()
        if slow := too_slow(self._config, self._wirings):
            problems.append(slow)
            log.warning("%s: %s", self._config.port, slow)
        if problems:
            self._account.warn(self._topic("wiring"), f"{self._config.port}: " + "; ".join(problems))
        else:
            self._account.clear(self._topic("wiring"))

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Send `frame`, which shows what was captured `age_s` ago. Returns at once."""
        pixels = {strip.id: strip.rgb for strip in frame.strips}
        shown = [wiring for wiring in self._wirings if wiring.strip_id in pixels]
        data, load = self._power.send([pixels[each.strip_id][: 3 * each.pixels] for each in shown])
        self._tell(load)
        picture = ExpanderFrame(
            tuple((each.channel, each.order, rgb) for each, rgb in zip(shown, data, strict=True)),
            time.monotonic(),
            age_s,
        )
        with self._change:
            self._newest = picture
            self._change.notify()

    def _tell(self, load: Load) -> None:
        self._account.set_metric(self._figure("current"), load.drawn_a, "A")
        now_s = time.monotonic()
        if load.limited:
            self._limited_s = now_s
            self._account.warn(
                self._topic("current"),
                f"{self._config.port}: frames need up to {load.wanted_a:.1f} A and are dimmed to "
                f"{self._config.max_current_a} A; lower the brightness, or give more power and raise "
                "`max_current_a`",
            )
        elif now_s - self._limited_s >= LIMIT_SHOWN_S:
            self._account.clear(self._topic("current"))

    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""
        await self._thread.run()

    def _wake(self) -> None:
        with self._change:
            self._change.notify()

    def _topic(self, what: str) -> str:
        return f"{what} {self._config.port}"

    def _figure(self, what: str) -> str:
        # a metric's name is short, a port's path may not be; its end distinguishes ports
        return f"{what} {self._config.port[-FIGURE_NAME:]}"

    def _on_port_change(self, why: str) -> None:
        if why:
            self._account.warn(self._topic("port"), f"LED controller: {why}")
            self._took_s.clear()
            self._busy_s.clear()
            self.light_s = 0.0
            self._account.set_metric(self._figure(FRAME_RATE), None)
            self._account.clear(self._topic("link"))
        else:
            self._account.clear(self._topic("port"))

    def _write(self, port: serial.Serial, stopping: threading.Event) -> None:
        """Send the newest frame whenever wire and board are ready. Runs in the port's thread."""
        shown: ExpanderFrame | None = None
        sent_s = 0.0
        while True:
            picture = self._next(shown, sent_s, stopping)
            if stopping.is_set():
                break
            if picture is None:
                continue
            if shown is None:
                # The board may be in the middle of an aborted frame, so that it discards this one.
                self._send(port, picture)
            is_new = picture != shown
            shown = picture
            sent_s = time.monotonic()
            self._send(port, picture, is_new=is_new)
        if shown is not None:
            self._send(port, shown.dark())

    def _next(
        self, shown: ExpanderFrame | None, sent_s: float, stopping: threading.Event
    ) -> ExpanderFrame | None:
        """Wait for a picture other than `shown`, or until it is time to resend that one."""
        with self._change:
            while not stopping.is_set():
                newest = self._newest
                left_s = sent_s + KEEP_ALIVE_S - time.monotonic()
                if newest is not None and (newest != shown or left_s <= 0.0):
                    return newest
                self._change.wait(left_s if newest is not None else KEEP_ALIVE_S)
        return None

    def _send(self, port: serial.Serial, picture: ExpanderFrame, *, is_new: bool = False) -> None:
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
        time.sleep(max(0.0, began_s + picture.draw_time_s() - time.monotonic()))

    def _on_sent(self, picture: ExpanderFrame, wire_s: float, took_s: float, new_s: float | None) -> None:
        """Count a frame whose last byte has left, at `new_s` if its picture is new."""
        if new_s is not None:
            self.light_s = new_s - picture.shown_s
            self._account.reached(picture.age_s + self.light_s)
        self._took_s.append(took_s)
        self._busy_s.append(max(took_s, picture.draw_time_s()))
        # not the rate of sending: a static scene sends few frames
        self._account.set_metric(self._figure(FRAME_RATE), len(self._busy_s) / sum(self._busy_s), "Hz")
        took_s = min(self._took_s)
        slow_s = max(SLOW_SHARE * wire_s, 1.0 / self._config.wanted_rate_hz)
        if took_s <= slow_s:
            self._account.clear(self._topic("link"))
        elif len(self._took_s) == SENT_FRAMES:
            self._account.warn(
                self._topic("link"),
                f"{self._config.port}: takes {took_s * 1e3:.0f} ms a frame, {1.0 / took_s:.1f} frames a "
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


EXPANDER = LedOutput(
    summary="a serial LED expander (UPXL: ElectroMage, Pixelblaze)",
    config=ExpanderConfig,
    make=lambda config, around: ExpanderOutput(config, around.health),
    argument="port",
    example="PORT",
)
