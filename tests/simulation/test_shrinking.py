"""Leaving out faults."""

from collections.abc import Sequence

from tests.simulation.faults.fault import Fault, parse_fault
from tests.simulation.run.shrinking import shrink

FAULTS = [Fault(float(at_s), "kill", "selector") for at_s in range(16)]


def test_only_the_faults_that_are_needed_together_are_left() -> None:
    def breaks(faults: Sequence[Fault]) -> bool:
        return FAULTS[3] in faults and FAULTS[11] in faults

    assert shrink(FAULTS, breaks) == [FAULTS[3], FAULTS[11]]


def test_no_fault_is_left_when_none_is_needed() -> None:
    assert shrink(FAULTS, lambda _faults: True) == []


def test_a_fault_is_read_as_it_is_written() -> None:
    fault = Fault(12.401, "kill at", "selector", 2.0, 3.0, "after selection/events")

    assert parse_fault(fault.line()) == fault
