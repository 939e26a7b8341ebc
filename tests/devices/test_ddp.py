"""DDP, decoded by a package of others: scenario_3 on several outputs, and outputs that cannot be reached."""

import importlib
from typing import Any

import pytest

from pointit.testing import UdpDevice
from tests.devices.published_frames import Pixels, Published, require_shown, scenario_3
from tests.support.bench import until

Packet: Any = importlib.import_module("ddp.packet").Packet
"""Packet of python-led-ddp, which is untyped."""

FRAMES = 40
MIXED = (
    {"strip": "0", "reversed": True, "order": "GRB", "offset": 500},
    {"strip": "1", "first": 100, "offset": 10},
    {"strip": "1", "pixels": 100, "offset": 200},
)


class Controller(UdpDevice):
    """Pixels that are shown whenever a packet tells to."""

    def frames(self) -> list[bytes]:
        """Return all bytes at each push."""
        pixels, shown = bytearray(), list[bytes]()
        for datagram in self.datagrams:
            packet = Packet.from_bytes(datagram)
            start, end = packet.header.offset, packet.header.offset + packet.header.length
            assert packet.header.length == len(packet.data) <= 1440
            pixels.extend(bytes(max(0, end - len(pixels))))
            pixels[start:end] = packet.data
            if packet.header.packet_type.push:
                shown.append(bytes(pixels))
        return shown


def mixed(strips: dict[str, list[Pixels]]) -> bytes:
    """Return the bytes that `MIXED` stands for, computed pixel by pixel."""
    pixels: list[Pixels] = [(0, 0, 0)] * 650
    for number in range(150):
        red, green, blue = strips["0"][149 - number]
        pixels[500 + number] = (green, red, blue)
    for number in range(50):
        pixels[10 + number] = strips["1"][100 + number]
    for number in range(100):
        pixels[200 + number] = strips["1"][number]
    return b"".join(map(bytes, pixels))


async def test_published_frames_arrive_pixel_for_pixel_on_any_part_of_two_outputs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    published, first, second = Published(monkeypatch), Controller(), Controller()
    outputs: list[dict[str, object]] = [
        {"kind": "ddp", "host": "127.0.0.1", "port": first.port, "segments": MIXED},
        {
            "kind": "ddp",
            "host": "localhost",
            "port": second.port,
            "segments": [{"strip": "1", "order": "RGBW"}],
        },
    ]
    for device in (first, second):
        await device.plug()
    async with scenario_3(
        outputs, lambda: all(len(set(device.frames())) > FRAMES for device in (first, second))
    ):
        pass
    await until(lambda: not any(any(device.frames()[-1]) for device in (first, second)))
    require_shown(first.frames(), [mixed(strips) for strips in published])
    white = [b"".join(bytes((*pixel, 0)) for pixel in strips["1"]) for strips in published]
    require_shown(second.frames(), white)
    types = {str(Packet.from_bytes(each).header.pixel_config.data_type.name) for each in second.datagrams}
    assert types == {"RGBW"}
    for device in (first, second):
        await device.unplug()
        device.close()
