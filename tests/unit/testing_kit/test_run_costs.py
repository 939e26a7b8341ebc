"""The report of what a run of tests took: files and tests that took most, and the time that was idle."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.run_costs import FILES, Cost, RunCosts

ROOT = Path(__file__).parents[3]
TESTS = """
import time

def test_quick(): ...

def test_busy():
    end_s = time.process_time() + 0.1
    while time.process_time() < end_s: ...
"""


def cost(*, process: str, began_s: float, wall_s: float, cpu_s: float) -> Cost:
    return Cost(process=process, began_s=began_s, ended_s=began_s + wall_s, cpu_s=cpu_s)


@pytest.fixture
def costs() -> RunCosts:
    """Return a run of 20 s in two processes on two cores, of which one process ends 6 s before the other."""
    tests = {
        "tests/a.py::test_waits": cost(process="gw0", began_s=102.0, wall_s=10.0, cpu_s=1.0),
        "tests/a.py::test_starts_others": cost(process="gw0", began_s=112.0, wall_s=2.0, cpu_s=3.0),
        "tests/b.py::test_computes": cost(process="gw1", began_s=104.0, wall_s=11.0, cpu_s=11.0),
        "tests/c.py::test_next[1::2]": cost(process="gw1", began_s=119.0, wall_s=1.0, cpu_s=0.0),
    }
    return RunCosts(tests=tests, began_s=100.0, ended_s=120.0, cpu_s=30.0, cores=2)


def test_time_of_cores_without_cpu_is_idle(costs: RunCosts) -> None:
    assert costs.idle_share() == pytest.approx(1 - 30 / 40)


def test_time_of_processes_is_split_into_its_uses(costs: RunCosts) -> None:
    assert costs.process_shares() == pytest.approx(
        {
            "in tests that compute": (1 + 2 + 11) / 40,
            "in tests that wait": (9 + 1) / 40,
            "before their first test": (2 + 4) / 40,
            "after their last test": 6 / 40,
            "between tests": 4 / 40,
        }
    )


def test_files_are_listed_by_wall_time_and_by_cpu(costs: RunCosts) -> None:
    lines = list(costs.lines())

    assert (
        lines[0]
        == "4 tests in 20 s with 30 s of CPU: 25% of the time of 2 cores was left to others or to nobody"
    )
    assert lines[1].startswith("time of 2 processes: 35% in tests that compute, 25% in tests that wait, ")
    assert lines[2:6] == [
        "slowest files by wall time:",
        "  12.00 s tests/a.py (4.00 s of CPU)",
        "  11.00 s tests/b.py (11.00 s of CPU)",
        "   1.00 s tests/c.py (0.00 s of CPU)",
    ]
    assert lines[6:8] == ["files with most CPU:", "  11.00 s tests/b.py (11.00 s of wall time)"]
    assert lines[10:12] == ["tests that wait longest:", "   9.00 s tests/a.py::test_waits"]
    assert lines[15:17] == ["tests with most CPU:", "  11.00 s tests/b.py::test_computes"]


def test_only_the_slowest_files_are_listed() -> None:
    tests = {
        f"tests/{number}.py::test": cost(process="", began_s=0.0, wall_s=number, cpu_s=0.0)
        for number in range(3 * FILES)
    }
    lines = list(RunCosts(tests=tests, began_s=0.0, ended_s=1.0, cpu_s=1.0, cores=1).lines())

    slowest = lines[3 : lines.index("files with most CPU:")]
    assert len(slowest) == FILES
    assert slowest[0].startswith(f"  {3 * FILES - 1}.00 s tests/{3 * FILES - 1}.py")


def test_plugin_measures_tests_in_processes_of_xdist(tmp_path: Path) -> None:
    (tmp_path / "test_some.py").write_text(TESTS)

    plugins = ("-p", "xdist", "-p", "tests.support.cpu_times")
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n1", f"--rootdir={tmp_path}", *plugins, str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        check=False,
    )

    assert "2 tests in " in ended.stdout, ended.stdout + ended.stderr
    assert "time of 1 processes: " in ended.stdout
    _, _, heaviest = ended.stdout.partition("tests with most CPU:\n")
    assert "test_some.py::test_busy" in heaviest.splitlines()[0]
