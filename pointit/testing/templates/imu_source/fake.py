"""The device in software, for tests and `pointit plugin check`."""

from pointit.plugins import Quaternion
from pointit.testing import ImuHarness, TcpDevice
from pointit.testing.templates.imu_source import SOURCE


def encode(orientation: Quaternion) -> bytes:
    """Return the bytes that the device sends for the orientation x, y, z, w."""
    x, y, z, w = orientation
    return f"{w},{x},{y},{z}\n".encode()


DEVICE = ImuHarness(
    plugin=SOURCE,
    device=TcpDevice,
    parameters=lambda device: {"host": device.host, "port": device.port},
    encode=encode,
    wrong_parameters=({"host": ""}, {"host": "imu.local", "port": 0}),
)
