"""Adalight over a pseudo-terminal: scenario_3, read as the sketches of Arduinos read it.

No registry has a decoder of Adalight. This one does what the sketches do: wait for the magic word, check the
count, read the pixels.
"""

import pytest

from pointit.testing import PtyDevice
from tests.devices.published_frames import Published, require_shown, scenario_3
from tests.support.bench import until

FRAMES = 40
PIXELS = 320


def sketch(received: bytearray) -> list[bytes]:
    """Return the pixels of each frame, read byte by byte."""
    frames: list[bytes] = []
    at, matched = 0, 0
    while at < len(received):
        matched = matched + 1 if received[at] == b"Ada"[matched] else int(received[at] == b"A"[0])
        at += 1
        if matched < len(b"Ada"):
            continue
        matched = 0
        high, low, check = received[at : at + 3].ljust(3, b"\0")
        at += 3
        if check != high ^ low ^ 0x55:
            continue
        size = 3 * (256 * high + low + 1)
        if at + size <= len(received):
            frames.append(bytes(received[at : at + size]))
        at += size
    return frames


async def test_published_frames_arrive_pixel_for_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    published, device = Published(monkeypatch), PtyDevice()
    await device.plug()
    segments = [{"strip": "1", "reversed": True, "order": "BRG"}, {"strip": "0", "offset": PIXELS - 150}]
    output = {"kind": "adalight", "port": str(device.path), "baud": 2_000_000, "segments": segments}
    async with scenario_3([output], lambda: len(set(sketch(device.received))) > FRAMES):
        pass
    await until(lambda: not any(sketch(device.received)[-1]))
    wanted: list[bytes] = []
    for strips in published:
        turned = [bytes((blue, red, green)) for red, green, blue in reversed(strips["1"])]
        gap = bytes(3 * (PIXELS - 300))
        wanted.append(b"".join((*turned, gap, *map(bytes, strips["0"]))))
    require_shown(sketch(device.received), wanted)
    await device.unplug()
    device.close()
