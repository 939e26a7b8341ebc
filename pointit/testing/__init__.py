r"""Contracts of plug-ins: classes of pytest with the promises of each kind, such as an IMU source.

The author of a plug-in describes a fake device once, and inherits one test for each promise:

    class TestMyWrist(ImuSourceContract):
        plugin = SOURCE
        wrong_parameters = ({"port": 0},)
        device = TcpDevice

        def encode(self, orientation_xyzw: Quaternion) -> bytes:
            return b"%f,%f,%f,%f\n" % orientation_xyzw

Declared as an entry point of the group `pointit.fake_devices`, under the name of the plug-in, the class is
run by `pointit plugin check NAME`, too. A promise that the device cannot show is skipped.

`memory_bench` starts a service on a bus in memory for tests of its own. `in_virtual_time` runs such a test
without waiting, `until` waits for a condition, and `no_task_left` fails if tasks are left running.
"""

from typing import Any

from pointit.testing import old_names
from pointit.testing.bench import Bench, ManualClock, in_virtual_time, memory_bench, no_task_left, until
from pointit.testing.contract import CheckFailedError, Contract
from pointit.testing.devices import FakeDevice, PtyDevice, TcpDevice, UdpDevice
from pointit.testing.imu import ImuSourceContract
from pointit.testing.led import LedOutputContract
from pointit.testing.methods import SelectionMethodContract
from pointit.testing.recogniser import RecogniserContract
from pointit.testing.robot import RobotContract
from pointit.testing.service import ServiceContract, ServiceTrial
from pointit.testing.trial import DeviceContract

__all__ = [
    "Bench",
    "CheckFailedError",
    "Contract",
    "DeviceContract",
    "FakeDevice",
    "ImuSourceContract",
    "LedOutputContract",
    "ManualClock",
    "PtyDevice",
    "RecogniserContract",
    "RobotContract",
    "SelectionMethodContract",
    "ServiceContract",
    "ServiceTrial",
    "TcpDevice",
    "UdpDevice",
    "in_virtual_time",
    "memory_bench",
    "no_task_left",
    "until",
]

_HARNESSES = {
    "ImuHarness": ImuSourceContract,
    "LedHarness": LedOutputContract,
    "MethodHarness": SelectionMethodContract,
    "RecogniserHarness": RecogniserContract,
    "RobotHarness": RobotContract,
    "ServiceHarness": ServiceContract,
}


def __getattr__(name: str) -> Any:
    """Return an old name, which works until the next minor version."""
    if name in _HARNESSES:
        return old_names.harness(name, _HARNESSES[name])
    if name in {"Check", "checks", "run_checks"}:
        return getattr(old_names, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
