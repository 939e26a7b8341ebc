"""A plugin (`-p tests.support.cpu_times`): at the end, the files and tests that took most, and what was idle.

What processes took that a test started and waited for counts, also forked ones. Durations on a busy machine
tell of others; CPU does not.
"""

import dataclasses
import functools
import os
import threading
import time
from collections.abc import Generator
from multiprocessing import forkserver
from typing import Any

import psutil
import pytest

from tests.support.run_costs import Cost, RunCosts

STOP_S = 10.0
"""Longest wait for it, s: it stays while a process that it forked does."""
_COST = "cost"
"""Name of the property of a test's last report, which travels from other processes, too."""
_BEGAN = pytest.StashKey[tuple[float, float]]()
"""Monotonic time and CPU at the start of a test, s."""
_SESSION_BEGAN_S = pytest.StashKey[float]()
_costs: dict[str, Cost] = {}
_FORKS = getattr(forkserver, "_forkserver", None)
"""The process that commands are forked from, which ends last. Nobody else waits for it."""


def _cpu_s() -> float:
    own = os.times()
    of_this_s = own.user + own.system + own.children_user + own.children_system
    pid: int | None = getattr(_FORKS, "_forkserver_pid", None)
    return of_this_s if pid is None else of_this_s + _of(_process(pid))


@functools.cache
def _process(pid: int) -> psutil.Process:
    return psutil.Process(pid)


def _of(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system + times.children_user + times.children_system)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Note when the run begins."""
    session.config.stash[_SESSION_BEGAN_S] = time.monotonic()


def pytest_unconfigure() -> None:
    """Wait for the process that commands are forked from, so that `time` counts what they took."""
    stop = getattr(_FORKS, "_stop", lambda: None)
    ending = threading.Thread(target=stop, daemon=True)
    ending.start()
    ending.join(STOP_S)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None]:
    """Begin to measure a test."""
    item.stash[_BEGAN] = time.monotonic(), _cpu_s()
    yield


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, None, object]:
    """Give a test's last report its cost."""
    if call.when == "teardown":
        began_s, cpu_before_s = item.stash[_BEGAN]
        cost = Cost(
            process=os.environ.get("PYTEST_XDIST_WORKER", ""),
            began_s=began_s,
            ended_s=time.monotonic(),
            cpu_s=_cpu_s() - cpu_before_s,
        )
        item.user_properties.append((_COST, dataclasses.asdict(cost)))
    report: object = yield
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note it."""
    for name, value in report.user_properties:
        if name == _COST:
            fields: Any = value
            _costs[report.nodeid] = Cost(**fields)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Print the report, when all other processes have ended."""
    if not _costs:
        return
    costs = RunCosts(
        tests=_costs,
        began_s=config.stash[_SESSION_BEGAN_S],
        ended_s=time.monotonic(),
        cpu_s=_cpu_s(),
        cores=os.cpu_count() or 1,
    )
    terminalreporter.section("costs")
    for line in costs.lines():
        terminalreporter.line(line)
