"""Parts of strips on the channels of an expander, and the duration of their frame on the wire. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from pointit.schemas import Strip
from pointit.services.led_driver.output.pixel_map import PixelMap, map_pixels
from pointit.services.led_driver.output.serial_port import upxl_protocol
from pointit.services.led_driver.output.serial_port.config import (
    BITS_PER_BYTE,
    CHANNELS,
    ExpanderConfig,
    wire_time_s,
)
from pointit.services.led_driver.outputs import Segment

CHANNEL_PIXELS = 1 << 20
"""Pixels of a channel as far as the pixel map knows: none of its segments reaches into the next channel."""


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

    def split(self, pixels: bytes) -> list[bytes]:
        """Return the red, green and blue of each channel's pixels, given those of the pixel map."""
        return [pixels[each.start : each.start + 3 * each.pixels] for each in self.channels]


def map_channels(config: ExpanderConfig, strips: Sequence[Strip]) -> tuple[Wiring, list[str]]:
    """Return the channels of strips, and messages about what does not fit the board."""
    segments, problems = _segments(config, strips)
    # the board sorts the colours, and is told their order
    sorted_later = [segment.model_copy(update={"order": "RGB"}) for segment in segments]
    pixel_map, unfit = map_pixels(sorted_later, strips if segments else (), block_pixels=CHANNEL_PIXELS)
    channels: list[PixelChannel] = []
    for block in pixel_map.blocks:
        here = [segment for segment in segments if segment.universe == block.number]
        orders, names = {segment.order for segment in here}, dict.fromkeys(each.strip for each in here)
        if len(orders) > 1:
            problems.append(f"channel {block.number} has segments of several orders: use one for a channel")
        pixels, order = block.size // 3, here[0].order
        limit = upxl_protocol.PIXEL_LIMITS[config.board]["W" in order]
        if pixels > limit:
            problems.append(
                f"channel {block.number} with strip {', '.join(names)} has {pixels} pixels, board "
                f"{config.board} drives {limit}: only the first {limit} light; use more channels, or set "
                "`board` to what you have"
            )
        channels.append(PixelChannel(block.number, order, min(pixels, limit), block.start))
    return Wiring(tuple(channels), pixel_map), problems + unfit


def _segments(config: ExpanderConfig, strips: Sequence[Strip]) -> tuple[list[Segment], list[str]]:
    if config.segments:
        return list(config.segments), []
    if not config.channels:
        problem = f"the map has {len(strips)} strips, one expander bus drives {CHANNELS}"
        segments = [
            Segment(strip=strip.id, universe=number, order="GRB")
            for number, strip in enumerate(strips[:CHANNELS])
        ]
        return segments, [problem] if len(strips) > CHANNELS else []
    known = {strip.id for strip in strips}
    segments = [
        Segment(strip=name, universe=each.channel, order=each.order)
        for name, each in config.channels.items()
        if name in known
    ]
    missing = [name for name in config.channels if name not in known]
    return segments, [f"the map has no strip {', '.join(missing)}: correct `channels`"] if missing else []


def frame_bytes(channels: Sequence[PixelChannel]) -> int:
    """Return the size of a frame of all `channels`."""
    return _overhead_bytes(channels) + _pixel_bytes(channels)


def too_slow(config: ExpanderConfig, channels: Sequence[PixelChannel]) -> str:
    """Return a message if wire or board carry fewer frames than wanted for these pixels, else `""`.

    The board draws a frame while the next one is sent, so the slower of the two limits.
    """
    pixels, wanted_hz = sum(each.pixels for each in channels), config.wanted_rate_hz
    longest = max((each.pixels for each in channels), default=0)
    wire_s = wire_time_s(frame_bytes(channels), config.baud)
    draw_s = upxl_protocol.draw_time_s(longest)
    if not pixels or max(wire_s, draw_s) * wanted_hz <= 1.0:
        return ""
    if wire_s >= draw_s:
        room_bytes = config.baud / BITS_PER_BYTE / wanted_hz - _overhead_bytes(channels)
        fitting = int(room_bytes / (_pixel_bytes(channels) / pixels))
        what, unit = f"{pixels} pixels at {config.baud} baud", "pixels"
        remedy = "spread the strips over more outputs"
    else:
        fitting = int((1.0 / wanted_hz - upxl_protocol.LATCH_TIME_S) / upxl_protocol.PIXEL_TIME_S)
        what, unit = f"a channel of {longest} pixels", "pixels a channel"
        remedy = "split the longest strips"
    frame_s = max(wire_s, draw_s)
    return (
        f"{what}: {frame_s * 1e3:.0f} ms a frame, {1.0 / frame_s:.1f} frames a second; "
        f"{max(0, fitting)} {unit} fit at {wanted_hz:g} frames a second: "
        f"{remedy}, or lower `wanted_rate_hz`"
    )


def _overhead_bytes(channels: Sequence[PixelChannel]) -> int:
    return len(channels) * upxl_protocol.SET_CHANNEL_BYTES + upxl_protocol.DRAW_ALL_BYTES


def _pixel_bytes(channels: Sequence[PixelChannel]) -> int:
    return sum(each.pixels * len(each.order) for each in channels)
