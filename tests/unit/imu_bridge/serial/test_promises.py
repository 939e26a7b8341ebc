"""The serial source keeps what it promises about data with each of its binary formats, too."""

import pytest

from pointit.testing import ImuHarness, checks, run_checks
from pointit_lab.devices.harnesses.imu import BNO085_HARNESS, SERIAL_XIMU3_HARNESS, WITMOTION_HARNESS

ABOUT_DATA = {"delivers", "bad_bytes", "not_finite", "not_unit"}
"""Checks that depend on the format; `pointit plugin check` makes all of them with lines of text."""


@pytest.mark.parametrize(
    "harness", [WITMOTION_HARNESS, BNO085_HARNESS, SERIAL_XIMU3_HARNESS], ids=["witmotion", "bno085", "ximu3"]
)
def test_source_keeps_its_promises_about_data(harness: ImuHarness) -> None:
    chosen = [check for check in checks(harness) if check.name in ABOUT_DATA]
    assert len(chosen) == len(ABOUT_DATA)
    assert [problem for _, problem in run_checks(chosen) if problem] == []
