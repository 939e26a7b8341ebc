"""Each seeded fault is caught by the test that is made for it."""

import gc
from collections.abc import Generator

import pytest

from pointit.testing import CheckFailedError
from tests.unit.testing_kit import (
    faulty_methods,
    faulty_outputs,
    faulty_recognisers,
    faulty_robots,
    faulty_services,
    faulty_sources,
)
from tests.unit.testing_kit.faults import FAULTS

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]
assert all(
    (faulty_methods, faulty_outputs, faulty_recognisers, faulty_robots, faulty_services, faulty_sources)
)


@pytest.fixture(autouse=True)
def _no_garbage() -> Generator[None]:
    """Have the warnings about what faulty plug-ins leave open within the test."""
    yield
    gc.collect()


@pytest.mark.parametrize("name", FAULTS)
def test_seeded_fault_is_caught(name: str) -> None:
    fault = FAULTS[name]
    with pytest.raises(CheckFailedError, match=fault.words):
        getattr(fault.contract(), fault.test)()
