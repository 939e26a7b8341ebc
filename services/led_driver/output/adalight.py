"""Output to a controller on a serial port that takes Adalight: an Arduino, or WLED on USB.

A frame is `Ada`, the number of pixels less one (2 bytes), a check byte, and red, green, blue of each pixel.

No core: it writes to a serial port.
"""

from collections.abc import Sequence

from pydantic import Field

from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Strip
from pointit.services.led_driver.output.pixel_map import PixelMap, map_pixels
from pointit.services.led_driver.output.serial_output import (
    BITS_PER_BYTE,
    MAX_BAUD,
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


class AdalightOutput(SerialOutput):
    """Sends frames to one controller."""

    def __init__(self, config: AdalightConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self._adalight = config

    def map_strips(self, strips: Sequence[Strip]) -> tuple[PixelMap, list[str]]:
        """Return the pixels of `strips`, and sentences about what the controller and its wire cannot show."""
        pixel_map, problems = map_pixels(self._adalight.segments, strips)
        if pixel_map.pixels > MAX_PIXELS:
            problems.append(f"{pixel_map.pixels} pixels are more than Adalight has, 65536: use more outputs")
            pixel_map, _ = map_pixels((), ())
        problems += _too_slow(self._adalight, pixel_map.pixels)
        return pixel_map.covering(self.pixel_map), problems

    def encode(self, pixels: bytes) -> bytes:
        """Return the frame that shows `pixels`, `b""` without pixels."""
        return encode_frame(pixels) if pixels else b""

    def draw_time_s(self) -> float:
        """Return the time in which the board draws a frame, s."""
        return draw_time_s(self.pixel_map.pixels)


def _too_slow(config: AdalightConfig, pixels: int) -> list[str]:
    """Return a message if wire and board cannot carry the configured frame rate for these pixels."""
    wanted_hz = config.wanted_rate_hz
    wire_s = wire_time_s(HEADER_BYTES + 3 * pixels, config.baud)
    frame_s = wire_s + draw_time_s(pixels)
    if frame_s * wanted_hz <= 1.0:
        return []

    # Pixels for which the period leaves time, on the wire and on the LEDs one after the other
    room_s = 1.0 / wanted_hz - LATCH_TIME_S - wire_time_s(HEADER_BYTES, config.baud)
    pixel_s = 3 * BITS_PER_BYTE / config.baud + PIXEL_TIME_S
    fitting = max(0, int(room_s / pixel_s))
    faster = "raise `baud` here and on the controller, " if config.baud < MAX_BAUD else ""
    frame_ms = frame_s * 1e3
    rate_hz = 1.0 / frame_s
    sentence = (
        f"{pixels} pixels at {config.baud} baud: {frame_ms:.0f} ms a frame, {rate_hz:.1f} frames "
        f"a second; {fitting} pixels fit at {wanted_hz:g} frames a second: {faster}"
        "use more outputs, or lower `wanted_rate_hz`"
    )
    return [sentence]


ADALIGHT = LedOutput(
    summary="an Arduino or WLED on a serial port (Adalight)",
    config=AdalightConfig,
    make=AdalightOutput,
    argument="port",
    example="PORT",
)
