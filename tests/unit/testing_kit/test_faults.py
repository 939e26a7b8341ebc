"""Each seeded fault is caught by the check that is made for it."""

import re
from collections.abc import Iterable
from dataclasses import replace

import pytest

from pointit.testing import checks, run_checks
from tests.support.pace import MOST, slowness
from tests.unit.testing_kit import (
    faulty_methods,
    faulty_outputs,
    faulty_robots,
    faulty_services,
    faulty_sources,
)
from tests.unit.testing_kit.faults import FAULTS

# one fixture tries all faults, some for as long as a busy machine takes
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
assert all((faulty_methods, faulty_outputs, faulty_robots, faulty_services, faulty_sources))


def reports_of(names: Iterable[str], patience: float = 1.0) -> dict[str, str]:
    """Return the reports of the checks of faults, which get `patience` times as long, by the fault's name."""
    named = [
        replace(check, name=name)
        for name in names
        for check in checks(
            replace(FAULTS[name].harness, timeout_s=patience * FAULTS[name].harness.timeout_s)
        )
        if check.name == FAULTS[name].check
    ]
    return {check.name: problem for check, problem in run_checks(named)}


@pytest.fixture(scope="module")
def reports() -> dict[str, str]:
    """Return the report of the check of each fault, by the fault's name. They run side by side.

    Checks that a busy machine has kept from their result get as many times as long as it is slow, once.
    """
    found = reports_of(FAULTS)
    late = [name for name, report in found.items() if not re.search(FAULTS[name].words, report)]
    return found | (reports_of(late, min(MOST, slowness())) if late else {})


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", FAULTS)
def test_seeded_fault_is_caught(name: str, reports: dict[str, str]) -> None:
    fault = FAULTS[name]
    (check,) = [each for each in checks(fault.harness) if each.name == fault.check]
    assert re.search(fault.words, reports[name]), reports[name]
    assert check.remedy in reports[name]


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_output_without_a_heartbeat_breaks_one_promise_whose_remedy_names_it() -> None:
    harness = FAULTS["LedOutput-HasNoHeartbeat-reconnects-came back, and did not get"].harness
    broken = {check.name: problem for check, problem in run_checks(checks(harness)) if problem}
    assert broken.keys() == {"reconnects"}
    assert "again every second" in broken["reconnects"]
