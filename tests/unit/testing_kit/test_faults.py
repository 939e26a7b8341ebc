"""Each seeded fault is caught by the check that is made for it."""

import re
from dataclasses import replace

import pytest

from pointit.testing import checks, run_checks
from tests.unit.testing_kit import faulty_methods, faulty_outputs, faulty_services, faulty_sources

FAULTS = {
    **{f"source_{name}": fault for name, fault in faulty_sources.FAULTS.items()},
    **{f"output_{name}": fault for name, fault in faulty_outputs.FAULTS.items()},
    **{f"method_{name}": fault for name, fault in faulty_methods.FAULTS.items()},
    **{f"service_{name}": fault for name, fault in faulty_services.FAULTS.items()},
}


@pytest.fixture(scope="module")
def reports() -> dict[str, str]:
    """Return the report of the check of each fault, by the fault's name. They run side by side."""
    named = [
        replace(check, name=name)
        for name, fault in FAULTS.items()
        for check in checks(fault.harness)
        if check.name == fault.check
    ]
    return {check.name: problem for check, problem in run_checks(named)}


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", FAULTS)
def test_seeded_fault_is_caught(name: str, reports: dict[str, str]) -> None:
    fault = FAULTS[name]
    (check,) = [each for each in checks(fault.harness) if each.name == fault.check]
    assert re.search(fault.words, reports[name]), reports[name]
    assert check.remedy in reports[name]
