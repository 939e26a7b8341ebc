"""Promises of an IMU source, with its device in software, for tests and `pointit plugin check`."""

from pointit.plugins import Quaternion
from pointit.testing import ImuSourceContract, TcpDevice
from pointit.testing.templates.imu_source import SOURCE


class SourcePromises(ImuSourceContract):
    """Contract of this plug-in: one test for each promise."""

    plugin = SOURCE
    wrong_parameters = ({"host": ""}, {"host": "imu.local", "port": 0})
    device = TcpDevice

    def encode(self, orientation_xyzw: Quaternion) -> bytes:
        """Return the bytes that the device sends for the orientation x, y, z, w."""
        x, y, z, w = orientation_xyzw
        return f"{w},{x},{y},{z}\n".encode()
