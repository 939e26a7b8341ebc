"""A hook by which the report of a test that has failed says what each thread of its process does."""

import contextlib
import faulthandler
import os
import shutil
import subprocess
import tempfile
from collections.abc import Generator
from pathlib import Path

import pytest

SHOW = (
    "[(t.switch(), gdb.execute('bt 25')) for t in gdb.selected_inferior().threads() if t.name[:3] == 'rx-']"
)
"""Command of gdb's Python: the stacks of Zenoh's receiving threads, on which there is no Python."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add Python's stacks, what threads wait for and, where gdb is, the stacks of Zenoh's receivers."""
    report = yield
    if report.failed:
        with tempfile.TemporaryFile("w+") as file:
            faulthandler.dump_traceback(file)
            for task in Path("/proc/self/task").glob("*"):
                with contextlib.suppress(OSError):  # it has ended
                    print(
                        (task / "comm").read_text().strip(),
                        (task / "wchan").read_text(),
                        file=file,
                        flush=True,
                    )
            if shutil.which("gdb") is not None:
                command = [
                    "gdb",
                    "-p",
                    str(os.getpid()),
                    "-batch",
                    "-iex",
                    "set auto-load no",
                    "-ex",
                    f"python {SHOW}",
                ]
                subprocess.run(command, stdout=file, stderr=subprocess.DEVNULL, check=False)
            file.seek(0)
            report.sections.append(("threads of this process", file.read()))
    return report
