r"""Checks of plug-ins: the promises of each kind, such as an IMU source or a robot driver.

The author of a plug-in describes a fake device once, and gets one test for each promise:

    DEVICE = ImuHarness(
        plugin=SOURCE,
        device=TcpDevice,
        parameters=lambda device: {"host": device.host, "port": device.port},
        encode=lambda xyzw: b"%f,%f,%f,%f\n" % xyzw,
    )

    @pytest.mark.parametrize("check", checks(DEVICE), ids=str)
    def test_promise(check: Check) -> None:
        check.run()

Declared as an entry point of the group `pointit.fake_devices`, under the name of the plug-in, the harness is
found by `pointit plugin check NAME`, too.

`memory_bench` starts a service on a bus in memory for tests of its own. `in_virtual_time` runs such a test
without waiting, `until` waits for a condition, and `no_task_left` fails if tasks are left running.
"""

from typing import Any

from pointit.testing.bench import Bench, ManualClock, in_virtual_time, memory_bench, no_task_left, until
from pointit.testing.devices import FakeDevice, PtyDevice, TcpDevice, UdpDevice
from pointit.testing.imu import IMU_SUITE, ImuHarness
from pointit.testing.led import LED_SUITE, LedHarness
from pointit.testing.methods import METHOD_SUITE, MethodHarness
from pointit.testing.recogniser import RECOGNISER_SUITE, RecogniserHarness
from pointit.testing.robot import ROBOT_SUITE, RobotHarness
from pointit.testing.service import SERVICE_SUITE, ServiceHarness, ServiceTrial
from pointit.testing.trial import Check, CheckFailedError, DeviceHarness, Harness, Suite, run_checks

__all__ = [
    "Bench",
    "Check",
    "CheckFailedError",
    "DeviceHarness",
    "FakeDevice",
    "Harness",
    "ImuHarness",
    "LedHarness",
    "ManualClock",
    "MethodHarness",
    "PtyDevice",
    "RecogniserHarness",
    "RobotHarness",
    "ServiceHarness",
    "ServiceTrial",
    "TcpDevice",
    "UdpDevice",
    "checks",
    "in_virtual_time",
    "memory_bench",
    "no_task_left",
    "run_checks",
    "until",
]
SUITES: dict[type[Harness[Any]], Suite[Any]] = {
    ImuHarness: IMU_SUITE,
    LedHarness: LED_SUITE,
    MethodHarness: METHOD_SUITE,
    RecogniserHarness: RECOGNISER_SUITE,
    RobotHarness: ROBOT_SUITE,
    ServiceHarness: SERVICE_SUITE,
}


def checks(harness: Harness[Any]) -> list[Check]:
    """Return the checks that can be made with `harness`, for `pytest.mark.parametrize`."""
    return SUITES[type(harness)].checks(harness)
