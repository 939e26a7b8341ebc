"""The order of tests in processes of pytest-xdist."""

import pytest

from tests.architecture.sources import ROOT
from tests.support.schedule import FIRST_SHARE, SEPARATE_FILES, start_shares, unit_of


def items_of(file: str, count: int) -> list[tuple[str, bool]]:
    return [(f"{file}::test_{number}[a::b]", False) for number in range(count)]


def test_tests_of_a_file_stay_together() -> None:
    shares = start_shares(items_of("tests/unit/web/test_a.py", 3))
    assert shares == {"tests/unit/web/test_a.py": 0.0}


@pytest.mark.parametrize("file", sorted(SEPARATE_FILES))
def test_tests_of_separate_files_are_units(file: str) -> None:
    tests = items_of(file, 3)
    assert start_shares(tests).keys() == {test for test, _ in tests}
    assert all(unit_of(test) == test for test, _ in tests)


def test_separate_files_exist() -> None:
    assert all((ROOT / file).is_file() for file in SEPARATE_FILES)


def test_files_of_each_folder_are_spread_over_the_run() -> None:
    unit = [f"tests/unit/test_{number}.py" for number in range(10)]
    devices = [f"tests/devices/test_{number}.py" for number in range(2)]
    shares = start_shares([(f"{file}::test", False) for file in (*unit, *devices)])

    assert [shares[file] for file in unit] == [number / 10 for number in range(10)]
    assert [shares[file] for file in devices] == [0.0, FIRST_SHARE / 2]


def test_files_with_fewest_tests_are_last() -> None:
    sizes = {"a": 9, "b": 1, "c": 9, "d": 2, "e": 9, "f": 9, "g": 9, "h": 9, "i": 9, "j": 9}
    tests = [test for name, size in sizes.items() for test in items_of(f"tests/e2e/{name}.py", size)]
    shares = start_shares(tests)

    order = sorted(shares, key=lambda unit: shares[unit])
    assert order == [f"tests/e2e/{name}.py" for name in "acefghijbd"]


def test_file_with_slow_tests_is_not_last() -> None:
    tests = [(f"tests/e2e/{name}.py::test", name == "e") for name in "abcde"]
    shares = start_shares(tests)
    assert max(shares, key=lambda unit: shares[unit]) == "tests/e2e/d.py"
