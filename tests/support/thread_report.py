"""A hook by which the report of a test that waited in vain says what each thread of its process does.

The stacks stand above the failure, so that the failed assertion is at the end. A plain assertion has none.
"""

import contextlib
import faulthandler
import os
import shutil
import subprocess
import tempfile
from collections.abc import Generator, Sequence
from pathlib import Path

import pytest
from _pytest._code.code import ExceptionChainRepr, ReprEntryNative, ReprTraceback

from pointit.runtime.errors import PointItError
from pointit.testing.bench import WaitError

WAITS: tuple[type[BaseException], ...] = (WaitError, TimeoutError, PointItError, pytest.fail.Exception)
"""Failures for which stacks help: something did not come in time. The last is that of `pytest-timeout`."""
RECEIVER = "rx-"
"""Begin of the names of Zenoh's receiving threads, on which there is no Python."""
SHOW = (
    "[(t.switch(), gdb.execute('bt 25')) "
    f"for t in gdb.selected_inferior().threads() if t.name.startswith('{RECEIVER}')]"
)
"""Command of gdb's Python: the stacks of these threads."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    call: pytest.CallInfo[object],
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add Python's stacks, what threads wait for and, where gdb is, the stacks of Zenoh's receivers."""
    report = yield
    if call.excinfo is None or not report.failed:
        return report
    if not _is_wait(call.excinfo.value):
        return report
    if isinstance(report.longrepr, ExceptionChainRepr):
        lines = _stacks().splitlines(keepends=True)
        stacks = ReprEntryNative(["threads of this process:\n", *lines])
        above = ReprTraceback([stacks], extraline=None, style="native")
        chain = [(above, None, "The failure:"), *report.longrepr.chain]
        report.longrepr = ExceptionChainRepr(chain)
    return report


def _is_wait(error: BaseException) -> bool:
    """Return True if `error` is one of `WAITS`, or a group with one."""
    if isinstance(error, BaseExceptionGroup):
        members: Sequence[BaseException] = error.exceptions
        return any(_is_wait(member) for member in members)
    return isinstance(error, WAITS)


def _stacks() -> str:
    """Return the stacks of the threads of this process, and what each waits for."""
    names: list[str] = []
    with tempfile.TemporaryFile("w+") as file:
        faulthandler.dump_traceback(file)
        for task in Path("/proc/self/task").glob("*"):
            with contextlib.suppress(OSError):  # it has ended
                name = (task / "comm").read_text().strip()
                print(name, (task / "wchan").read_text(), file=file, flush=True)
                names.append(name)
        has_receivers = any(name.startswith(RECEIVER) for name in names)
        if has_receivers and shutil.which("gdb") is not None:
            command = ["gdb", "-p", str(os.getpid()), "-batch", "-iex", "set auto-load no"]
            command += ["-ex", f"python {SHOW}"]
            subprocess.run(command, stdout=file, stderr=subprocess.DEVNULL, check=False)
        file.seek(0)
        return file.read()
