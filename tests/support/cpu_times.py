"""A plugin (`-p tests.support.cpu_times`): at the end, the tests that took most CPU.

What processes took that a test started and waited for counts, also forked ones. Durations on a busy machine
tell of others.
"""

import os
import threading
from collections.abc import Generator
from multiprocessing import forkserver

import psutil
import pytest

HEAVIEST = 40
STOP_S = 10.0
"""Longest wait for it, s: it stays while a process that it forked does."""
_CPU_S = "cpu_s"
_BEGAN = pytest.StashKey[float]()
_cpu_s: dict[str, float] = {}
_FORKS = getattr(forkserver, "_forkserver", None)
"""The process that commands are forked from, which ends last. Nobody else waits for it."""


def _now_s() -> float:
    now_s = _of(os.getpid())
    forking = getattr(_FORKS, "_forkserver_pid", None)
    if forking:
        now_s += _of(forking)
    return now_s


def _of(pid: int) -> float:
    times = psutil.Process(pid).cpu_times()
    own_s = times.user + times.system
    children_s = times.children_user + times.children_system
    return float(own_s + children_s)


def pytest_unconfigure() -> None:
    """Wait for the process that commands are forked from, so that `time` counts what they took."""
    stop = getattr(_FORKS, "_stop", lambda: None)
    ending = threading.Thread(target=stop, daemon=True)
    ending.start()
    ending.join(STOP_S)


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
        took_s = _now_s() - item.stash[_BEGAN]
        item.user_properties.append((_CPU_S, took_s))
    report: object = yield
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note it."""
    for name, value in report.user_properties:
        if name == _CPU_S:
            _cpu_s[report.nodeid] = float(str(value))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the heaviest, and what all took."""
    tests = sorted(_cpu_s.items(), key=lambda test: -test[1])
    total_s = sum(_cpu_s.values())
    terminalreporter.section(f"most CPU of {total_s:.0f} s in {len(tests)} tests")
    for name, took_s in tests[:HEAVIEST]:
        terminalreporter.line(f"{took_s:6.2f} s {name}")
