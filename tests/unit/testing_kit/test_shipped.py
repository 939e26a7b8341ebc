"""The plug-ins that come with PointIt, and those that `pointit plugin new` writes, keep all promises."""

import pytest

from pointit.testing import Harness, checks, run_checks, shipped
from pointit.testing.templates.imu_source import fake as imu_source
from pointit.testing.templates.led_output import fake as led_output

HARNESSES: dict[str, Harness] = {
    "serial": shipped.SERIAL_HARNESS,
    "simulated": shipped.SIMULATED_HARNESS,
    "replay": shipped.REPLAY_HARNESS,
    "page": shipped.PAGE_HARNESS,
    "expander": shipped.EXPANDER_HARNESS,
    "template of an IMU source": imu_source.DEVICE,
    "template of an LED output": led_output.DEVICE,
}


@pytest.mark.parametrize("harness", HARNESSES.values(), ids=HARNESSES)
def test_plugin_keeps_all_promises(harness: Harness) -> None:
    found = dict(run_checks(checks(harness)))
    assert len(found) >= 7
    assert not [problem for problem in found.values() if problem]
