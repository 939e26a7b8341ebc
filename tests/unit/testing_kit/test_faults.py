"""Each seeded fault is caught by the check that is made for it."""

import asyncio
import re
from collections.abc import Iterable
from dataclasses import replace

import pytest

from pointit.plugins import ConfigError, MethodConfig, Surroundings
from pointit.testing import CheckFailedError, checks, run_checks
from pointit.testing.common import require_bounded_memory
from pointit.testing.templates.selection_method import METHOD, Method
from pointit.testing.templates.selection_method.fake import DEVICE
from tests.support.pace import MOST, slowness
from tests.unit.testing_kit import (
    faulty_methods,
    faulty_outputs,
    faulty_robots,
    faulty_services,
    faulty_sources,
)
from tests.unit.testing_kit.faults import FAULTS

pytestmark = pytest.mark.timeout(900)  # one fixture tries all faults, some as long as a busy machine takes
assert all((faulty_methods, faulty_outputs, faulty_robots, faulty_services, faulty_sources))


def reports_of(names: Iterable[str], patience: float = 1.0) -> dict[str, str]:
    """Return the reports of the checks of faults, which get `patience` times as long, by the fault's name."""
    named = [
        replace(check, name=name)
        for name in names
        for check in checks(
            replace(FAULTS[name].harness, patience_s=patience * FAULTS[name].harness.patience_s)
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


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_output_without_a_heartbeat_breaks_one_promise_whose_remedy_names_it() -> None:
    harness = FAULTS["LedOutput-HasNoHeartbeat-reconnects-came back, and did not get"].harness
    broken = {check.name: problem for check, problem in run_checks(checks(harness)) if problem}
    assert broken.keys() == {"reconnects"}
    assert "again every second" in broken["reconnects"]


def test_make_of_a_method_may_refuse_parameters() -> None:
    def make(config: MethodConfig, surroundings: Surroundings) -> Method:
        if config.dwell_s > 5.0:
            raise ConfigError("dwell_s: is too long; give at most 5 s")
        return Method(config, surroundings)

    harness = replace(DEVICE, plugin=replace(METHOD, make=make), wrong_parameters=({"dwell_s": 6.0},))
    (check,) = [each for each in checks(harness) if each.name == "config_errors"]
    check.run()


async def test_memory_check_outlasts_one_that_was_given_up() -> None:
    begun, given_up = asyncio.Event(), asyncio.Event()
    kept: list[bytes] = []

    async def idle() -> None:
        begun.set()
        await given_up.wait()

    async def keep() -> None:
        kept.append(bytes(1_000_000))
        given_up.set()
        await asyncio.gather(other, return_exceptions=True)  # its own verdict does not matter

    other = asyncio.create_task(require_bounded_memory(idle, "nothing"))
    await begun.wait()
    with pytest.raises(CheckFailedError, match=r"after much it held 1\.0 MB more"):
        await require_bounded_memory(keep, "much")
    assert kept
