"""The log of the installed version of Zenoh, in comparison with the sample of the version that was read."""

from collections.abc import Iterable
from pathlib import Path

import pytest

from pointit.access.zenoh_trace import Operation, TraceCounts, ZenohTrace
from tests.integration.access.trace_sample import SAMPLE, log_of_router

OperationKey = tuple[str, str, str]


def counts_of(log: bytes) -> TraceCounts:
    trace = ZenohTrace()
    for line in log.split(b"\n"):
        trace.take(line.decode(errors="replace"))
    return trace.pop()


def keys_of(operations: Iterable[Operation]) -> set[OperationKey]:
    """Return common name, kind and key of operations, without the names of connections."""
    return {(operation.common_name, operation.message, operation.key) for operation in operations}


@pytest.mark.slow
def test_log_of_a_router_is_read_as_the_sample_is(tmp_path: Path) -> None:
    sample = counts_of(SAMPLE.read_bytes())
    counts = counts_of(log_of_router(tmp_path))
    for kind in ("writes", "requests", "denied", "too_frequent", "too_long"):
        assert keys_of(getattr(counts, kind)) == keys_of(getattr(sample, kind)), kind
    assert counts.rejected == sample.rejected
    assert counts.long_lines == sample.long_lines
