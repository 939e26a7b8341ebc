"""A plugin (`-p tests.support.cpu_times`): at the end, the tests that took most CPU.

What processes took that a test started and waited for counts. Durations on a busy machine tell of others.
"""

import os
from collections.abc import Generator

import pytest

HEAVIEST = 40
_CPU_S = "cpu_s"
_BEGAN = pytest.StashKey[float]()
_cpu_s: dict[str, float] = {}


def _now_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None]:
    """Begin to measure a test."""
    item.stash[_BEGAN] = _now_s()
    yield


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, None, object]:
    """Give a test's last report its CPU time, which travels from other processes, too."""
    if call.when == "teardown":
        item.user_properties.append((_CPU_S, _now_s() - item.stash[_BEGAN]))
    report: object = yield
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note it."""
    for name, value in report.user_properties:
        if name == _CPU_S:
            _cpu_s[report.nodeid] = float(str(value))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the heaviest, and what all took."""
    tests = sorted(_cpu_s.items(), key=lambda each: -each[1])
    terminalreporter.section(f"most CPU of {sum(_cpu_s.values()):.0f} s in {len(tests)} tests")
    for name, took_s in tests[:HEAVIEST]:
        terminalreporter.line(f"{took_s:6.2f} s {name}")
