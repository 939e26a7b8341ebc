"""An output to a serial LED expander: the newest frame, no faster than wire and board take it."""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import serial

from pointit.runtime.health import Warnings
from pointit.runtime.serial_port import PortSettings, SerialThread
from pointit.schemas import Strip, StripsFrame
from pointit.services.led_driver import upxl
from pointit.services.led_driver.config import OutputConfig
from pointit.services.led_driver.power import Load, Power

KEEP_ALIVE_S = 1.0
"""An unchanged frame is sent again after this: a board that was plugged in or lost a frame recovers."""

LIMIT_SHOWN_S = 2.0
"""That frames were dimmed is said for so long: health is looked at once a second."""

FIGURE_NAME = 50
"""So many letters of the port's name are in that of its figure."""

CHANNELS = 64
BITS_PER_BYTE = 10
"""On the wire, with start and stop bit."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """A strip's place on the board."""

    strip_id: str
    channel: int
    order: str
    pixels: int
    """As many as are sent: not more than the board drives."""


@dataclass(frozen=True, slots=True)
class Picture:
    """What the board shows: (channel, order, rgb) of each strip."""

    channels: tuple[tuple[int, str, bytes], ...] = ()

    def dark(self) -> "Picture":
        """Return the same channels, all black."""
        return Picture(tuple((channel, order, bytes(len(rgb))) for channel, order, rgb in self.channels))

    def data(self) -> bytes:
        """Return the bytes that show it."""
        return b"".join(upxl.set_channel(*channel) for channel in self.channels) + upxl.draw_all()

    def draw_time_s(self) -> float:
        """Return how long the board draws it."""
        return upxl.draw_time_s(max((len(rgb) // 3 for _, _, rgb in self.channels), default=0))


class Account(Warnings, Protocol):
    """Where an output gives account of itself; `ServiceBus` is one."""

    def figure(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a number of its own; none takes it away."""
        ...


class ExpanderOutput:
    """Sends frames to one expander from a thread of its own; unsent frames give way to newer ones."""

    def __init__(self, config: OutputConfig, account: Account) -> None:
        self._config = config
        self._account = account
        self._power = Power(config)
        self._limited_s = -LIMIT_SHOWN_S
        self._wirings: tuple[Wiring, ...] = ()
        self._change = threading.Condition()
        self._newest: Picture | None = None
        self._thread = SerialThread(
            PortSettings(port=config.port, baud=config.baud), self._write, self._on_port_change, self._wake
        )
        self.sent = 0
        """Frames written since the start."""

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Take the map's strips; says in health what of them the board cannot show."""
        self._wirings, problems = wire(self._config, strips)
        if problems:
            self._account.warn(self._topic("wiring"), f"{self._config.port}: " + "; ".join(problems))
        else:
            self._account.clear(self._topic("wiring"))

    def show(self, frame: StripsFrame) -> None:
        """Have `frame` sent; returns at once."""
        pixels = {strip.id: strip.rgb for strip in frame.strips}
        shown = [wiring for wiring in self._wirings if wiring.strip_id in pixels]
        data, load = self._power.send([pixels[each.strip_id][: 3 * each.pixels] for each in shown])
        self._tell(load)
        picture = Picture(
            tuple((each.channel, each.order, rgb) for each, rgb in zip(shown, data, strict=True))
        )
        with self._change:
            self._newest = picture
            self._change.notify()

    def _tell(self, load: Load) -> None:
        # a figure's name is short, a port's path may not be; its end tells ports apart
        self._account.figure(f"current {self._config.port[-FIGURE_NAME:]}", load.drawn_a, "A")
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
        """Send until cancelled; the strips are dark afterwards."""
        await self._thread.run()

    def _wake(self) -> None:
        with self._change:
            self._change.notify()

    def _topic(self, what: str) -> str:
        return f"{what} {self._config.port}"

    def _on_port_change(self, why: str) -> None:
        if why:
            self._account.warn(self._topic("port"), f"LED controller: {why}")
        else:
            self._account.clear(self._topic("port"))

    def _write(self, port: serial.Serial, stopping: threading.Event) -> None:
        """Send what is newest whenever wire and board are ready; in the port's thread."""
        shown: Picture | None = None
        sent_s = 0.0
        while True:
            picture = self._next(shown, sent_s, stopping)
            if stopping.is_set():
                break
            if picture is None:
                continue
            if shown is None:
                # The board may be in the middle of a frame of ours that broke off: it swallows this one.
                self._send(port, picture)
            shown = picture
            sent_s = time.monotonic()
            self._send(port, picture)
        if shown is not None:
            self._send(port, shown.dark())

    def _next(self, shown: Picture | None, sent_s: float, stopping: threading.Event) -> Picture | None:
        """Wait for a picture other than `shown`, or until it is time to send that one again."""
        with self._change:
            while not stopping.is_set():
                newest = self._newest
                left_s = sent_s + KEEP_ALIVE_S - time.monotonic()
                if newest is not None and (newest != shown or left_s <= 0.0):
                    return newest
                self._change.wait(left_s if newest is not None else KEEP_ALIVE_S)
        return None

    def _send(self, port: serial.Serial, picture: Picture) -> None:
        """Write, and wait until wire and board are done: a buffer full of old frames would be latency."""
        began_s = time.monotonic()
        data = picture.data()
        port.write(data)
        self.sent += 1
        wire_s = len(data) * BITS_PER_BYTE / self._config.baud
        time.sleep(max(0.0, max(wire_s, picture.draw_time_s()) + began_s - time.monotonic()))


def wire(config: OutputConfig, strips: Sequence[Strip]) -> tuple[tuple[Wiring, ...], list[str]]:
    """Return which strips go to which channels, and sentences about what does not fit the board."""
    problems: list[str] = []
    wirings: list[Wiring] = []
    if config.channels:
        places = {name: (channel.channel, channel.order) for name, channel in config.channels.items()}
        missing = [name for name in places if name not in {strip.id for strip in strips}]
        if missing:
            problems.append(f"the map has no strip {', '.join(missing)}: correct `channels`")
    else:
        places = {strip.id: (number, "GRB") for number, strip in enumerate(strips[:CHANNELS])}
        if len(strips) > CHANNELS:
            problems.append(f"the map has {len(strips)} strips, one expander bus drives {CHANNELS}")
    for strip in strips:
        if strip.id not in places:
            continue
        channel, order = places[strip.id]
        limit = upxl.PIXEL_LIMITS[config.board]["W" in order]
        if strip.pixels > limit:
            problems.append(
                f"strip {strip.id} has {strip.pixels} pixels, a channel of board {config.board} drives "
                f"{limit}: only the first {limit} light; split the strip, or set `board` to what you have"
            )
        wirings.append(Wiring(strip.id, channel, order, min(strip.pixels, limit)))
    return tuple(wirings), problems
