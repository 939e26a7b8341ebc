"""Harnesses of the plug-ins that come with PointIt, declared like those of any package."""

import zlib
from pathlib import Path
from tempfile import TemporaryDirectory

from pointit.services.imu_bridge.replay_source import REPLAY
from pointit.services.imu_bridge.serial_source import SERIAL
from pointit.services.imu_bridge.simulated import SIMULATED
from pointit.services.imu_bridge.sources import PAGE
from pointit.services.led_driver.output.expander import EXPANDER
from pointit.services.led_driver.output.upxl_protocol import DRAW_ALL, MAGIC, SET_CHANNEL_WS2812
from pointit.services.selector.methods.shipped import FRACTION, GAUGE, HOLD
from pointit.testing.devices.device import FakeDevice
from pointit.testing.devices.pty import PtyDevice
from pointit.testing.imu import ImuHarness
from pointit.testing.led import LedHarness
from pointit.testing.methods import MethodHarness
from pointit.testing.templates.imu_source.fake import encode

RECORDED_S = 60
CRC_BYTES = 4
PIXELS_AT = 6
"""Offset of the pixels behind `MAGIC`, bytes."""


class Recording(FakeDevice):
    """A file with a recording of a sensor at rest, 10 samples a second."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = TemporaryDirectory()
        self.path = Path(self._folder.name) / "recording.csv"
        lines = [f"{number / 10},1,0,0,0" for number in range(10 * RECORDED_S)]
        self.path.write_text("\n".join(["t,qw,qx,qy,qz", *lines]), encoding="ascii")

    def close(self) -> None:
        """Remove the file."""
        self._folder.cleanup()


def frames(received: bytes) -> list[bytes]:
    """Return the frames that an expander has drawn: its channels at each draw command."""
    drawn: list[bytes] = []
    channels: dict[int, bytes] = {}
    for part in received.split(MAGIC)[1:]:
        whole, check = part[:-CRC_BYTES], part[-CRC_BYTES:]
        if zlib.crc32(MAGIC + whole) != int.from_bytes(check, "little"):
            continue
        if whole[1] == SET_CHANNEL_WS2812:
            channels[whole[0]] = whole[PIXELS_AT:]  # red, green, blue: the board sorts them
        elif whole[1] == DRAW_ALL:
            drawn.append(b"".join(channels[number] for number in sorted(channels)))
    return drawn


SERIAL_HARNESS = ImuHarness(
    plugin=SERIAL,
    device=PtyDevice,
    parameters=lambda device: {"port": str(device.path)},
    encode=encode,
    wrong_parameters=({"port": ""}, {"port": "/dev/ttyUSB0", "baud": 0}),
)
SIMULATED_HARNESS = ImuHarness(plugin=SIMULATED, virtual_time=True)
REPLAY_HARNESS = ImuHarness(
    plugin=REPLAY,
    device=Recording,
    parameters=lambda device: {"recording": str(device.path)},
    wrong_parameters=({"recording": ""}, {"recording": "missing.csv"}),
    virtual_time=True,
)
PAGE_HARNESS = ImuHarness(plugin=PAGE, delivers=False, virtual_time=True)
EXPANDER_HARNESS = LedHarness(
    plugin=EXPANDER,
    device=PtyDevice,
    parameters=lambda device: {"port": str(device.path)},
    decode=frames,
)
HOLD_HARNESS = MethodHarness(plugin=HOLD)
FRACTION_HARNESS = MethodHarness(plugin=FRACTION)
GAUGE_HARNESS = MethodHarness(plugin=GAUGE)
