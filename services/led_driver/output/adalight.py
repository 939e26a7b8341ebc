"""Output to a controller on a serial port that takes Adalight: an Arduino, or WLED on USB.

A frame is `Ada`, the number of pixels less one (2 bytes), a check byte, and red, green, blue of each pixel.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from pydantic import Field

from pointit.runtime.service.plugin_guard import HealthSink
from pointit.schemas import Strip, StripsFrame
from pointit.services.led_driver.output.pixel_map import Power, map_pixels
from pointit.services.led_driver.output.serial_output import (
    BITS_PER_BYTE,
    MAX_BAUD,
    SerialFrame,
    SerialOutput,
    SerialOutputConfig,
    wire_time_s,
)
from pointit.services.led_driver.outputs import LedOutput

MAGIC = b"Ada"
HEADER_BYTES = 6
MAX_PIXELS = 65536
PIXEL_TIME_S = 30e-6
LATCH_TIME_S = 300e-6
"""Duration of drawing. A board without DMA receives nothing meanwhile."""


def encode_frame(pixels: bytes) -> bytes:
    """Return the frame that shows `pixels`, 3 bytes each, 1 to 65536 of them."""
    high, low = divmod(len(pixels) // 3 - 1, 256)
    return MAGIC + bytes((high, low, high ^ low ^ 0x55)) + pixels


def draw_time_s(pixels: int) -> float:
    """Return the time in which the board draws this number of `pixels`, s."""
    return pixels * PIXEL_TIME_S + LATCH_TIME_S


class AdalightConfig(SerialOutputConfig):
    """A controller on a serial port that takes Adalight, of which the pixels have three colours."""

    kind: str = Field(default="adalight", description="kind of controller")


@dataclass(frozen=True)
class AdalightFrame(SerialFrame):
    """Pixels of the controller, 3 bytes each."""

    pixels: bytes

    draws_while_receiving: ClassVar[bool] = False

    def opening(self) -> "AdalightFrame":
        """Return a dark frame: its rest behind an aborted one is no command of WLED, such as another rate."""
        return self.dark()

    def dark(self) -> "AdalightFrame":
        """Return the same pixels, all black."""
        return replace(self, pixels=bytes(len(self.pixels)))

    def data(self) -> bytes:
        """Return the bytes of the protocol that show it."""
        return encode_frame(self.pixels)

    def draw_time_s(self) -> float:
        """Return the time that the controller takes to draw it, s."""
        return draw_time_s(len(self.pixels) // 3)


class AdalightOutput(SerialOutput):
    """Sends frames to one controller."""

    def __init__(self, config: AdalightConfig, health: HealthSink) -> None:
        super().__init__(config, health)
        self._adalight = config
        self._power = Power(config)
        self._map, _ = map_pixels((), ())

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the map's strips. Reports in health what the controller and its wire cannot show."""
        pixel_map, problems = map_pixels(self._adalight.segments, strips)
        if pixel_map.pixels > MAX_PIXELS:
            problems.append(f"{pixel_map.pixels} pixels are more than Adalight has, 65536: use more outputs")
            pixel_map, _ = map_pixels((), ())
        self._map = pixel_map.covering(self._map)
        self.set_problems([*problems, *_too_slow(self._adalight, pixel_map.pixels)])

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Send `frame`, which shows what was captured `age_s` ago. Returns at once."""
        if not self._map.pixels:
            return
        pixels, load = self._power.send(self._map.output_bytes(frame))
        self._health.show_load(load, self._adalight.max_current_a)
        self.send(AdalightFrame(pixels, shown_s=time.monotonic(), age_s=age_s))


def _too_slow(config: AdalightConfig, pixels: int) -> list[str]:
    """Return a message if wire and board cannot carry the configured frame rate for these pixels."""
    wire_s = wire_time_s(HEADER_BYTES + 3 * pixels, config.baud)
    frame_s = wire_s + draw_time_s(pixels)
    if frame_s * config.wanted_rate_hz <= 1.0:
        return []
    room_s = 1.0 / config.wanted_rate_hz - LATCH_TIME_S - wire_time_s(HEADER_BYTES, config.baud)
    fitting = int(room_s / (3 * BITS_PER_BYTE / config.baud + PIXEL_TIME_S))
    faster = "raise `baud` here and on the controller, " if config.baud < MAX_BAUD else ""
    sentence = (
        f"{pixels} pixels at {config.baud} baud: {frame_s * 1e3:.0f} ms a frame, {1.0 / frame_s:.1f} frames "
        f"a second; {max(0, fitting)} pixels fit at {config.wanted_rate_hz:g} frames a second: {faster}"
        "use more outputs, or lower `wanted_rate_hz`"
    )
    return [sentence]


ADALIGHT = LedOutput(
    summary="an Arduino or WLED on a serial port (Adalight)",
    config=AdalightConfig,
    make=lambda config, around: AdalightOutput(config, around.health),
    argument="port",
    example="PORT",
)
