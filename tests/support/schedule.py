"""Order in which the processes of pytest-xdist get the tests, and which tests stay together."""

from collections.abc import Collection, Iterable, Mapping
from pathlib import PurePosixPath

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadFileScheduling

SEPARATE_FILES = frozenset(
    {
        "tests/docs/test_pages.py",
        "tests/e2e/web/test_home.py",
        "tests/unit/testing_kit/test_promises.py",
    }
)
"""Files whose tests share no fixture and take minutes together: each process may get some of them."""

SLOW_SIZE = 20
"""Size of a test marked `slow`, as a number of others."""

SHORT_SHARE = 0.2
"""Share of the units of a folder that are the last: those with the fewest tests."""

FIRST_SHARE = 0.9
"""Share of the run in which the units of folders other than `tests/unit` begin, since those are longer."""


def unit_of(test: str) -> str:
    """Return the part of the tests that one process runs at a time: a test's file, or the test itself.

    Args:
        test: node ID.
    """
    file = test.partition("::")[0]
    return test if file in SEPARATE_FILES else file


def start_shares(tests: Iterable[tuple[str, bool]]) -> dict[str, float]:
    """Return the share of the run at which each unit begins.

    The units of each folder of `tests` are spread over the run, so that some processes wait while others
    compute. The shortest are last, so that no process is left alone with a long one.

    Args:
        tests: node ID of each test in the order of collection, and True if it is marked `slow`.
    """
    sizes_by_folder: dict[str, dict[str, int]] = {}
    for test, is_slow in tests:
        unit = unit_of(test)
        sizes = sizes_by_folder.setdefault(_folder(unit), {})
        sizes[unit] = sizes.get(unit, 0) + (SLOW_SIZE if is_slow else 1)

    shares: dict[str, float] = {}
    for folder, sizes in sizes_by_folder.items():
        whole = 1.0 if folder == "unit" else FIRST_SHARE
        for index, unit in enumerate(_short_last(sizes)):
            shares[unit] = whole * index / len(sizes)
    return shares


def _short_last(sizes: Mapping[str, int]) -> list[str]:
    by_size = sorted(sizes, key=lambda unit: sizes[unit], reverse=True)
    short_count = int(SHORT_SHARE * len(by_size))
    short: Collection[str] = frozenset(by_size[len(by_size) - short_count :])
    return sorted(sizes, key=lambda unit: unit in short)


def _folder(unit: str) -> str:
    _, folder, *_ = PurePosixPath(unit.partition("::")[0]).parts
    return folder


class UnitScheduling(LoadFileScheduling):
    """Gives each process one unit after another."""

    def _split_scope(self, nodeid: str) -> str:
        return unit_of(nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> UnitScheduling | None:
    """Schedule by units where it would be by files."""
    return UnitScheduling(config, log) if config.getoption("dist") == "loadfile" else None
