"""Bytes of UPXL, the protocol of serial LED expanders (ElectroMage, Pixelblaze Output Expander).

A frame is `UPXL`, channel, type, body, CRC-32 (little-endian) of all before; hardware.md B.1.
"""

import struct
import zlib

import numpy as np

MAGIC = b"UPXL"
SET_CHANNEL_WS2812 = 1
DRAW_ALL = 2
ALL_CHANNELS = 0xFF
PIXEL_LIMITS = {"v1": (240, 180), "v2": (800, 602), "v3": (1600, 1202)}
"""Pixels that a channel of each board drives, with three and with four colours. Longer frames are ignored."""
SET_CHANNEL_BYTES, DRAW_ALL_BYTES = 14, 10
"""Sizes of the two frames without pixels, bytes."""
PIXEL_TIME_S = 30e-6
LATCH_TIME_S = 300e-6
"""Duration of drawing. The board drops a draw command that comes earlier."""


def set_channel(channel: int, order: str, rgb: bytes) -> bytes:
    """Return the frame that sets the pixels of `channel`.

    Args:
        channel: channel number, 0 to 63.
        order: colours in their order on the LEDs' wire, `GRB`, `GRBW`. A white LED stays dark.
        rgb: 3 bytes per pixel: red, green, blue.
    """
    data = rgb
    if "W" in order:
        wide = np.zeros((len(rgb) // 3, 4), dtype=np.uint8)
        wide[:, :3] = np.frombuffer(rgb, dtype=np.uint8).reshape(-1, 3)
        data = wide.tobytes()
    head = struct.pack("<BBBBH", channel, SET_CHANNEL_WS2812, len(order), _order_byte(order), len(rgb) // 3)
    return _framed(head + data)


def draw_all() -> bytes:
    """Return the frame that makes every channel show its pixels."""
    return _framed(bytes((ALL_CHANNELS, DRAW_ALL)))


def draw_time_s(pixels: int) -> float:
    """Return the time that the board takes to draw if its longest channel has `pixels`, s."""
    return pixels * PIXEL_TIME_S + LATCH_TIME_S


def _order_byte(order: str) -> int:
    white = order.index("W") << 6 if "W" in order else 0
    return order.index("R") | order.index("G") << 2 | order.index("B") << 4 | white


def _framed(content: bytes) -> bytes:
    frame = MAGIC + content
    return frame + struct.pack("<I", zlib.crc32(frame))
