"""Reports of tests that have failed: stacks of threads only where they help, and above the failure."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
HEADING = "threads of this process"
FAILURES = """
import asyncio, pytest
from pointit.testing.bench import until

def test_assertion():
    assert 1 == 2, "they differ"

def test_wait():
    asyncio.run(until(lambda: False, 0.01, "the pose"))

def test_timeout():
    async def wait():
        async with asyncio.timeout(0.01), asyncio.TaskGroup() as tasks:
            tasks.create_task(asyncio.sleep(9.0))
    asyncio.run(wait())
"""


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the report of each failed test by its name, as pytest prints it."""
    path = tmp_path_factory.mktemp("failures") / "test_failures.py"
    path.write_text(FAILURES)
    plugins = ("-p", "no:cacheprovider", "-p", "no:xdist", "-p", "tests.support.thread_report")
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-rN", f"--rootdir={path.parent}", *plugins, str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.stdout.endswith("s\n"), ended.stdout + ended.stderr
    parts = re.split(r"^_+ (test_\w+) _+$", ended.stdout, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def test_plain_assertion_has_no_stacks(reports: dict[str, str]) -> None:
    assert "they differ" in reports["test_assertion"]
    assert HEADING not in reports["test_assertion"]


@pytest.mark.parametrize(
    ("test", "failure"),
    [("test_wait", "WaitError: waited 0.01 s in vain: the pose"), ("test_timeout", "TimeoutError")],
)
def test_stacks_of_threads_stand_above_the_failure(reports: dict[str, str], test: str, failure: str) -> None:
    stacks, _, below = reports[test].partition("The failure:")

    assert HEADING in stacks
    assert "(most recent call first)" in stacks
    assert failure in below
    assert HEADING not in below
