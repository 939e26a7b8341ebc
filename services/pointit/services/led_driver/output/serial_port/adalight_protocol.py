"""Bytes of Adalight, the serial protocol of Arduino sketches and of WLED's USB port.

A frame is `Ada`, the number of pixels less one (2 bytes), a check byte, and red, green, blue of each pixel.
"""

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
