"""Bytes of DDP, the Distributed Display Protocol of WLED, xLights and other pixel controllers.

A packet is flags, sequence, data type, id, offset (4 bytes) and size (2 bytes) of its data, the data.
"""

import struct

PORT = 4048
MAX_DATA_BYTES = 1440
"""Limit of the data of a packet, bytes: 480 pixels of three colours, 360 of four."""
VERSION, PUSH = 0x40, 0x01
DATA_TYPES = {3: 0x0B, 4: 0x1B}
"""Red, green, blue, and the same with white, 8 bits each."""
DEFAULT_ID = 1
SEQUENCES = 15
"""Sequence numbers go from 1 to this one. 0 is for packets without."""
SEQUENCED_PACKETS = 10
"""Limit of packets in a frame with sequence numbers. WLED would take later ones for late ones of the frame
before."""
_HEADER = struct.Struct(">BBBBIH")


def encode_frame(pixels: bytes, colors: int, number: int) -> list[bytes]:
    """Return the packets that show `pixels`. The last one makes the controller show all.

    Args:
        pixels: bytes of the output, `colors` a pixel.
        colors: 3, or 4 with white.
        number: number of the frame, from 1.
    """
    starts = range(0, len(pixels), MAX_DATA_BYTES)
    first = (number - 1) * len(starts)
    packets: list[bytes] = []
    for index, start in enumerate(starts):
        data = pixels[start : start + MAX_DATA_BYTES]
        flags = VERSION | (PUSH if index == len(starts) - 1 else 0)
        sequence = (first + index) % SEQUENCES + 1 if len(starts) <= SEQUENCED_PACKETS else 0
        packets.append(_HEADER.pack(flags, sequence, DATA_TYPES[colors], DEFAULT_ID, start, len(data)) + data)
    return packets
