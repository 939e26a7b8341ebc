"""Strips on a controller's channels, and the duration of their frame on the wire. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from pointit.schemas import Strip
from pointit.services.led_driver.output import upxl_protocol
from pointit.services.led_driver.output.expander_config import ExpanderConfig

FRAME_RATE = "frame rate"
"""First words of the name of the metric of a port's frames per second."""

CHANNELS = 64
BITS_PER_BYTE = 10
"""Bits on the wire, with start and stop bit."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """A strip's channel on the board."""

    strip_id: str
    channel: int
    order: str
    pixels: int
    """Number of pixels sent, limited to what the board drives."""


def map_channels(config: ExpanderConfig, strips: Sequence[Strip]) -> tuple[tuple[Wiring, ...], list[str]]:
    """Return the channels of strips, and messages about what does not fit the board."""
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
        limit = upxl_protocol.PIXEL_LIMITS[config.board]["W" in order]
        if strip.pixels > limit:
            problems.append(
                f"strip {strip.id} has {strip.pixels} pixels, a channel of board {config.board} drives "
                f"{limit}: only the first {limit} light; split the strip, or set `board` to what you have"
            )
        wirings.append(Wiring(strip.id, channel, order, min(strip.pixels, limit)))
    return tuple(wirings), problems


def wire_time_s(size_bytes: int, baud: int) -> float:
    """Return the time until the last of `size_bytes` has left a wire of `baud` bits per second."""
    return size_bytes * BITS_PER_BYTE / baud


def frame_bytes(wirings: Sequence[Wiring]) -> int:
    """Return the size of a frame of all `wirings`."""
    return _overhead_bytes(wirings) + _pixel_bytes(wirings)


def too_slow(config: ExpanderConfig, wirings: Sequence[Wiring]) -> str:
    """Return a message if wire or board carry fewer frames than wanted for these pixels, else `""`.

    The board draws a frame while the next one is sent, so the slower of the two limits.
    """
    pixels, wanted_hz = sum(each.pixels for each in wirings), config.wanted_rate_hz
    longest = max((each.pixels for each in wirings), default=0)
    wire_s = wire_time_s(frame_bytes(wirings), config.baud)
    draw_s = upxl_protocol.draw_time_s(longest)
    if not pixels or max(wire_s, draw_s) * wanted_hz <= 1.0:
        return ""
    if wire_s >= draw_s:
        room_bytes = config.baud / BITS_PER_BYTE / wanted_hz - _overhead_bytes(wirings)
        fitting = int(room_bytes / (_pixel_bytes(wirings) / pixels))
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


def _overhead_bytes(wirings: Sequence[Wiring]) -> int:
    return len(wirings) * upxl_protocol.SET_CHANNEL_BYTES + upxl_protocol.DRAW_ALL_BYTES


def _pixel_bytes(wirings: Sequence[Wiring]) -> int:
    return sum(each.pixels * len(each.order) for each in wirings)
