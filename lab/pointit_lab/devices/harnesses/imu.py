"""Harnesses of the IMU sources."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from pointit.services.imu_bridge.replay_source import REPLAY
from pointit.services.imu_bridge.serial.source import SERIAL
from pointit.services.imu_bridge.simulated import SIMULATED
from pointit.services.imu_bridge.sources import PAGE
from pointit.testing.devices import FakeDevice, PtyDevice
from pointit.testing.imu import ImuHarness
from pointit.testing.templates.imu_source.fake import encode
from pointit_lab.devices.serial_formats import bno085_orientation, witmotion_quaternion, ximu3_quaternion

RECORDED_S = 60


class ImuRecording(FakeDevice):
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


SERIAL_HARNESS = ImuHarness(
    plugin=SERIAL,
    device=PtyDevice,
    parameters=lambda device: {"port": str(device.path)},
    encode=encode,
    wrong_parameters=({"baud": -1}, {"format": "morse"}),
)
WITMOTION_HARNESS = replace(SERIAL_HARNESS, encode=witmotion_quaternion)
BNO085_HARNESS = replace(SERIAL_HARNESS, encode=bno085_orientation)
SERIAL_XIMU3_HARNESS = replace(SERIAL_HARNESS, encode=ximu3_quaternion)
"""Other formats of the same plug-in; its tests use them."""
SIMULATED_HARNESS = ImuHarness(plugin=SIMULATED, virtual_time=True)
REPLAY_HARNESS = ImuHarness(
    plugin=REPLAY,
    device=ImuRecording,
    parameters=lambda device: {"recording": str(device.path)},
    wrong_parameters=({"recording": ""}, {"recording": "missing.csv"}),
    virtual_time=True,
)
PAGE_HARNESS = ImuHarness(plugin=PAGE, delivers=False, virtual_time=True)
