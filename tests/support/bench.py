"""The bench of `pointit.testing`, with a patience that a busy machine makes longer."""

import asyncio
from collections.abc import Callable

from pointit.runtime.clock import is_virtual
from pointit.testing import bench
from pointit.testing.bench import (
    START_NS,
    Bench,
    ManualClock,
    background,
    in_virtual_time,
    memory_bench,
    repeated,
)
from tests.support.pace import Patience, VirtualPatience

__all__ = [
    "PATIENCE_S",
    "START_NS",
    "Bench",
    "ManualClock",
    "background",
    "in_virtual_time",
    "memory_bench",
    "repeated",
    "until",
]

PATIENCE_S = 30.0
"""A condition that comes true ends its wait at once: long patience costs time in a test that fails only."""


async def until(
    condition: Callable[[], bool], patience_s: float = PATIENCE_S, what: str | Callable[[], str] = ""
) -> None:
    """Wait for `condition`; fail, saying `what`, if it does not come true in time.

    `patience_s` is enough on a quiet machine. A machine whose cores are all busy may hold up another process
    for seconds, so that less than `PATIENCE_S` counts as `PATIENCE_S`.
    """
    patience_s = max(patience_s, PATIENCE_S)
    now_s = asyncio.get_running_loop().time
    patience = VirtualPatience(patience_s, now_s) if is_virtual() else Patience(patience_s)
    await bench.until(condition, patience_s, what, patience.is_over)
