"""Unit tests wait for no real time and read no real clock, but for those listed in wall_time.txt."""

from pathlib import Path

import pytest

from tests.architecture.sources import ROOT
from tests.architecture.wall_time import wall_time_calls

LIST = Path(__file__).with_name("wall_time.txt")
MOST = 268
"""Limit of the sum, which only falls."""
UNIT = ROOT / "tests/unit"


def listed() -> dict[str, int]:
    """Return the numbers of calls in the list, by file."""
    rows = (line.split() for line in LIST.read_text(encoding="utf-8").splitlines())
    return {name: int(count) for count, name in rows}


def test_unit_tests_wait_for_no_real_time() -> None:
    """Asynchronous unit tests run in virtual time unless they are marked `wall_time`."""
    found = {
        path.relative_to(UNIT).as_posix(): len(calls)
        for path in sorted(UNIT.rglob("*.py"))
        if (calls := wall_time_calls(path))
    }
    assert found == listed(), (
        "take the time of the loop or of a clock that the test moves; lower fallen counts"
    )
    assert sum(found.values()) <= MOST


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("import time\ntime.sleep(0.1)\ntime.monotonic()\n", 2),
        ("from time import sleep as wait\nwait(1)\n", 1),
        ("import time\ntime.sleep(0)\n", 0),
        ("import asyncio\nasync def test_a():\n    await asyncio.sleep(1)\n", 0),
        ("import asyncio\nimport pytest\npytestmark = pytest.mark.wall_time\nasyncio.sleep(1)\n", 1),
        ("import asyncio\nasyncio.run(main())\n", 1),
        ("from tests.support.pace import within\nwithin(1.0, 2.0)\n", 1),
    ],
)
def test_each_way_to_wait_is_found(tmp_path: Path, source: str, count: int) -> None:
    path = tmp_path / "module.py"
    path.write_text(source)
    assert len(wall_time_calls(path)) == count
