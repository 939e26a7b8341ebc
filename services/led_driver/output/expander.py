"""Output to a serial LED expander: channels with parts of strips, their wiring, and UPXL.

A frame is `UPXL`, channel, type, body, CRC-32 (little-endian) of all before.

No core: it writes to a serial port.
"""

import logging
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

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
from pointit.services.led_driver.outputs import LedOutput, Segment

log = logging.getLogger(__name__)
MAGIC = b"UPXL"
SET_CHANNEL_WS2812 = 1
DRAW_ALL = 2
ALL_CHANNELS = 0xFF
PIXEL_LIMITS = {"v1": (240, 180), "v2": (800, 602), "v3": (1600, 1202)}
"""Pixels that a channel of each board drives, with three and with four colours. Longer frames are ignored."""
SET_CHANNEL_BYTES = 14
"""Size of the frame that sets a channel, without pixels, bytes."""
DRAW_ALL_BYTES = 10
"""Size of the frame that draws, bytes."""
PIXEL_TIME_S = 30e-6
LATCH_TIME_S = 300e-6
"""Duration of drawing. The board drops a draw command that comes earlier."""

CHANNELS = 64
"""Number of channels: board number (0-7) times 8 plus port (0-7)."""

CHANNEL_PIXELS = 1 << 20
"""Pixels of a channel as far as the pixel map knows: none of its segments reaches into the next channel."""


def set_channel(channel: int, order: str, rgb: bytes) -> bytes:
    """Return the frame that sets the pixels of `channel`.

    Args:
        channel: channel number, 0 to 63.
        order: colours in their order on the LEDs' wire, `GRB`, `GRBW`. A white LED stays dark.
        rgb: 3 bytes per pixel: red, green, blue.
    """
    pixels = len(rgb) // 3
    data = rgb
    if "W" in order:
        wide = np.zeros((pixels, 4), dtype=np.uint8)
        colors = np.frombuffer(rgb, dtype=np.uint8)
        wide[:, :3] = colors.reshape(-1, 3)
        data = wide.tobytes()
    head = struct.pack("<BBBBH", channel, SET_CHANNEL_WS2812, len(order), _order_byte(order), pixels)
    return _framed(head + data)


def draw_all() -> bytes:
    """Return the frame that makes every channel show its pixels."""
    return _framed(bytes((ALL_CHANNELS, DRAW_ALL)))


def draw_time_s(pixels: int) -> float:
    """Return the time that the board takes to draw if its longest channel has `pixels`, s."""
    return pixels * PIXEL_TIME_S + LATCH_TIME_S


def _order_byte(order: str) -> int:
    red = order.index("R")
    green = order.index("G") << 2
    blue = order.index("B") << 4
    white = order.index("W") << 6 if "W" in order else 0
    return red | green | blue | white


def _framed(content: bytes) -> bytes:
    frame = MAGIC + content
    return frame + struct.pack("<I", zlib.crc32(frame))


class ExpanderConfig(SerialOutputConfig):
    """A serial LED expander (UPXL: ElectroMage, Pixelblaze).

    Strips are on channels 0, 1, 2 ... in the map's order without `segments`, whose `universe` is the channel.
    """

    kind: str = Field(default="expander", description="kind of controller")
    baud: int = Field(default=2_000_000, gt=0, le=MAX_BAUD, description="bits per second")
    board: Literal["v1", "v2", "v3"] = Field(
        default="v2", description="generation of the board: v1, v2, v3 drive 240, 800, 1600 pixels a channel"
    )

    @field_validator("segments")
    @classmethod
    def _equally_wide(cls, segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
        return segments  # in place of the base's: each channel may have a width of its own

    @model_validator(mode="after")
    def _have_channels(self) -> Self:
        for segment in self.segments:
            if segment.universe not in range(CHANNELS):
                raise ValueError(f"segments: each needs its channel, 0 to {CHANNELS - 1}, as `universe`")
        return self


@dataclass(frozen=True, slots=True)
class PixelChannel:
    """Pixels on a channel of the board."""

    number: int
    order: str
    """Colours in their order on the LEDs' wire."""
    pixels: int
    """Number of pixels sent, limited to what the board drives."""
    start: int = 0
    """First byte in the pixel map."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """Channels in use, and the source of their pixels."""

    channels: tuple[PixelChannel, ...]
    pixel_map: PixelMap

    def encode(self, pixels: bytes) -> bytes:
        """Return the frames that show `pixels` of the pixel map on all channels."""
        frames: list[bytes] = []
        for channel in self.channels:
            end = channel.start + 3 * channel.pixels
            rgb = pixels[channel.start : end]
            frames.append(set_channel(channel.number, channel.order, rgb))
        frames.append(draw_all())
        return b"".join(frames)


def map_channels(config: ExpanderConfig, strips: Sequence[Strip]) -> tuple[Wiring, list[str]]:
    """Return the channels of strips, and messages about what does not fit the board."""
    # The board itself sorts the colours, by the order in the frames
    segments, problems = _segments(config, strips)
    unsorted = [segment.model_copy(update={"order": "RGB"}) for segment in segments]
    mapped_strips = strips if segments else ()
    pixel_map, unmapped = map_pixels(unsorted, mapped_strips, block_pixels=CHANNEL_PIXELS)

    # A channel has one order, and drives fewer pixels if they have a white LED
    channels: list[PixelChannel] = []
    for block in pixel_map.blocks:
        channel_segments = [segment for segment in segments if segment.universe == block.number]
        orders = {segment.order for segment in channel_segments}
        names = dict.fromkeys(segment.strip for segment in channel_segments)
        if len(orders) > 1:
            problems.append(f"channel {block.number} has segments of several orders: use one for a channel")
        pixels = block.size // 3
        order = channel_segments[0].order
        limit = PIXEL_LIMITS[config.board]["W" in order]
        if pixels > limit:
            strip_names = ", ".join(names)
            problems.append(
                f"channel {block.number} with strip {strip_names} has {pixels} pixels, board "
                f"{config.board} drives {limit}: only the first {limit} light; use more channels, or set "
                "`board` to what you have"
            )
        channels.append(PixelChannel(block.number, order, min(pixels, limit), block.start))
    return Wiring(tuple(channels), pixel_map), problems + unmapped


def _segments(config: ExpanderConfig, strips: Sequence[Strip]) -> tuple[list[Segment], list[str]]:
    """Return the configured segments, or a channel for each strip, and sentences about what does not fit."""
    if config.segments:
        return list(config.segments), []
    segments: list[Segment] = []
    for number, strip in enumerate(strips[:CHANNELS]):
        segments.append(Segment(strip=strip.id, universe=number, order="GRB"))
    problems: list[str] = []
    if len(strips) > CHANNELS:
        problems.append(f"the map has {len(strips)} strips, one expander bus drives {CHANNELS}")
    return segments, problems


def frame_bytes(channels: Sequence[PixelChannel]) -> int:
    """Return the size of a frame of all `channels`."""
    return _overhead_bytes(channels) + _pixel_bytes(channels)


def too_slow(config: ExpanderConfig, channels: Sequence[PixelChannel]) -> str:
    """Return a message if wire or board carry fewer frames than wanted for these pixels, else `""`.

    The board draws a frame while the next one is sent, so the slower of the two limits.
    """
    pixels = sum(channel.pixels for channel in channels)
    longest = _longest_channel(channels)
    wire_s = wire_time_s(frame_bytes(channels), config.baud)
    draw_s = draw_time_s(longest)
    frame_s = max(wire_s, draw_s)
    wanted_hz = config.wanted_rate_hz
    if not pixels or frame_s * wanted_hz <= 1.0:
        return ""

    # The wire limits all pixels together, the board those of the longest channel
    if wire_s >= draw_s:
        bytes_per_frame = config.baud / BITS_PER_BYTE / wanted_hz
        room_bytes = bytes_per_frame - _overhead_bytes(channels)
        bytes_per_pixel = _pixel_bytes(channels) / pixels
        fitting = int(room_bytes / bytes_per_pixel)
        load = f"{pixels} pixels at {config.baud} baud"
        unit = "pixels"
        remedy = "spread the strips over more outputs"
    else:
        room_s = 1.0 / wanted_hz - LATCH_TIME_S
        fitting = int(room_s / PIXEL_TIME_S)
        load = f"a channel of {longest} pixels"
        unit = "pixels a channel"
        remedy = "split the longest strips"

    # A fixed part of a frame may already take too long
    fitting = max(0, fitting)
    frame_ms = frame_s * 1e3
    rate_hz = 1.0 / frame_s
    return (
        f"{load}: {frame_ms:.0f} ms a frame, {rate_hz:.1f} frames a second; "
        f"{fitting} {unit} fit at {wanted_hz:g} frames a second: "
        f"{remedy}, or lower `wanted_rate_hz`"
    )


def _longest_channel(channels: Sequence[PixelChannel]) -> int:
    """Return the number of pixels of the longest channel, 0 without channels."""
    return max((channel.pixels for channel in channels), default=0)


def _overhead_bytes(channels: Sequence[PixelChannel]) -> int:
    return len(channels) * SET_CHANNEL_BYTES + DRAW_ALL_BYTES


def _pixel_bytes(channels: Sequence[PixelChannel]) -> int:
    return sum(channel.pixels * len(channel.order) for channel in channels)


class ExpanderOutput(SerialOutput):
    """Sends frames to one expander."""

    DRAWS_WHILE_RECEIVING: ClassVar[bool] = True

    def __init__(self, config: ExpanderConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self._board = config
        self._wiring, _ = map_channels(config, ())

    def map_strips(self, strips: Sequence[Strip]) -> tuple[PixelMap, list[str]]:
        """Return the pixels of `strips`, and sentences about what board and wire cannot show."""
        self._wiring, problems = map_channels(self._board, strips)
        warning = too_slow(self._board, self._wiring.channels)
        if warning:
            problems.append(warning)
            log.warning("%s: %s", self._board.port, warning)
        return self._wiring.pixel_map, problems

    def encode(self, pixels: bytes) -> bytes:
        """Return the frames that show `pixels` on all channels."""
        return self._wiring.encode(pixels)

    def encode_opening(self, pixels: bytes) -> bytes:
        """Return the frames that show `pixels`: a board that is plugged in again does not blink."""
        return self.encode(pixels)

    def draw_time_s(self) -> float:
        """Return the time in which the board draws its longest channel, s."""
        return draw_time_s(_longest_channel(self._wiring.channels))


EXPANDER = LedOutput(
    summary="a serial LED expander (UPXL: ElectroMage, Pixelblaze)",
    config=ExpanderConfig,
    make=ExpanderOutput,
    argument="port",
    example="PORT",
)
