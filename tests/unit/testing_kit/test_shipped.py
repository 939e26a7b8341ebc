"""The plug-ins that come with PointIt, and those that `pointit plugin new` writes, keep all promises."""

from dataclasses import replace

import pytest

from pointit.plugins import GROUPS
from pointit.testing import Harness, checks, run_checks
from pointit.testing.installed import installed_harness
from pointit.testing.templates.imu_source import fake as imu_source
from pointit.testing.templates.led_output import fake as led_output
from pointit.testing.templates.selection_method import fake as selection_method
from pointit.testing.templates.service import fake as service

OURS = [
    pytest.param(installed_harness(name, group.get(name)), id=f"{kind} {name}")
    for kind, group in GROUPS.items()
    for name in group.names
    if group.package(name) == "pointit"
]
TEMPLATES = [
    pytest.param(fake.DEVICE, id=fake.__name__.split(".")[-2])
    for fake in (imu_source, led_output, selection_method, service)
]


def test_fake_device_of_another_plugin_of_that_name_is_not_used() -> None:
    serial = GROUPS["imu-source"].get("serial")
    assert installed_harness("serial", replace(serial)) is None


@pytest.mark.parametrize("harness", [*OURS, *TEMPLATES])
def test_plugin_keeps_all_promises(harness: Harness | None) -> None:
    assert harness is not None, "declare its fake device in pyproject.toml"
    found = dict(run_checks(checks(harness)))
    assert len(found) >= 7
    assert not [problem for problem in found.values() if problem]
