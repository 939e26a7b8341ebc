"""A plugin (`-p tests.support.strict_skips`): a test that is skipped for a reason not listed here fails.

Continuous integration uses it, so that a missing tool cannot hide tests unnoticed.
"""

import re
from collections.abc import Generator

import pytest

ALLOWED = (
    r"set POINTIT_DATA to the folder with the recordings",
    r"root may write everywhere",
    r"no IPv6 here",
    r"no espeak-ng or sox here",
    r"natnet 0\.3\.0 is not installed",
    r"the device of the contract cannot show it",
    r"the output cannot notice that its device has vanished",
)
"""Regular expressions, found in reasons."""

Report = pytest.TestReport | pytest.CollectReport


def _judged(report: Report) -> Report:
    if not report.skipped or hasattr(report, "wasxfail"):
        return report
    details = report.longrepr
    reason = details[2] if isinstance(details, tuple) else str(details)
    is_allowed = any(re.search(allowed, reason) for allowed in ALLOWED)
    if not is_allowed:
        report.outcome = "failed"
        report.longrepr = f"{reason}; that is no reason listed in tests/support/strict_skips.py"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Judge a test."""
    report = yield
    _judged(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Judge a module that skips itself as a whole."""
    report = yield
    _judged(report)
    return report
