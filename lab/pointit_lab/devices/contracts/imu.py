"""Contracts of the IMU sources."""

from pathlib import Path
from tempfile import TemporaryDirectory

from pointit.geometry.rotation import Quaternion
from pointit.services.imu_bridge.replay_source import REPLAY
from pointit.services.imu_bridge.serial.source import SERIAL
from pointit.services.imu_bridge.simulated import SIMULATED
from pointit.services.imu_bridge.sources import PAGE
from pointit.testing import FakeDevice, ImuSourceContract, PtyDevice

RECORDED_S = 60


class RestRecording(FakeDevice):
    """A file with a recording of a sensor at rest, 10 samples a second."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = TemporaryDirectory()
        self.path = Path(self._folder.name) / "recording.csv"
        lines = [f"{number / 10},1,0,0,0" for number in range(10 * RECORDED_S)]
        self.path.write_text("\n".join(["t,qw,qx,qy,qz", *lines]), encoding="ascii")
        self.address = {"recording": str(self.path)}

    def close(self) -> None:
        """Remove the file."""
        self._folder.cleanup()


class TestSerial(ImuSourceContract):
    plugin = SERIAL
    wrong_parameters = ({"baud": -1}, {"format": "morse"})
    device = PtyDevice

    def encode(self, orientation_xyzw: Quaternion) -> bytes:
        return "{3},{0},{1},{2}\n".format(*orientation_xyzw).encode()


class TestSimulatedWrist(ImuSourceContract):
    plugin = SIMULATED
    virtual_time = True
    sends = False


class TestReplay(ImuSourceContract):
    plugin = REPLAY
    virtual_time = True
    sends = False
    wrong_parameters = ({"recording": ""}, {"recording": "missing.csv"})
    device = RestRecording


class TestPage(ImuSourceContract):
    plugin = PAGE
    virtual_time = True
    sends = False
    delivers = False
