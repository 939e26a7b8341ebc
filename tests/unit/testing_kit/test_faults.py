"""Each seeded fault is caught by the check that is made for it."""

import re

import pytest

from pointit.testing import CheckFailedError, checks
from tests.unit.testing_kit import faulty_methods, faulty_outputs, faulty_sources
from tests.unit.testing_kit.faulty_sources import Fault

FAULTS = {
    **{f"source_{name}": fault for name, fault in faulty_sources.FAULTS.items()},
    **{f"output_{name}": fault for name, fault in faulty_outputs.FAULTS.items()},
    **{f"method_{name}": fault for name, fault in faulty_methods.FAULTS.items()},
}


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_seeded_fault_is_caught(fault: Fault) -> None:
    (check,) = [each for each in checks(fault.harness) if each.name == fault.check]
    with pytest.raises(CheckFailedError) as caught:
        check.run()
    assert re.search(fault.words, str(caught.value)), caught.value
    assert check.remedy in str(caught.value)
