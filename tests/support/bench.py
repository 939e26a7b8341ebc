"""The bench of `pointit.testing`, with a patience that a busy machine makes longer."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

from pointit.runtime.virtual_time import START_NS as VIRTUAL_START_NS
from pointit.runtime.virtual_time import VirtualTimeLoop, is_virtual
from pointit.testing import bench
from pointit.testing.bench import START_NS, Bench, ManualClock, in_virtual_time, memory_bench
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
    "stand_still",
    "until",
]

PATIENCE_S = 30.0
"""A condition that comes true ends its wait at once: long patience costs time in a test that fails only."""


def stand_still(duration_s: float) -> None:
    """Let virtual time pass while nothing in the loop runs, as in a process that is stopped and continued."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop), "only virtual time can be moved"
    loop.virtual.passed_s += duration_s
    loop.virtual.now_ns = VIRTUAL_START_NS + round(loop.virtual.passed_s * 1e9)


@asynccontextmanager
async def repeated(period_s: float, step: Callable[[], object]) -> AsyncGenerator[None]:
    """Call `step` each period, and await what it returns if that can be awaited."""

    async def repeat() -> None:
        while True:
            result = step()
            if isinstance(result, Awaitable):
                await result
            await asyncio.sleep(period_s)

    async with background(repeat()):
        yield


@asynccontextmanager
async def background(work: Coroutine[Any, Any, None]) -> AsyncGenerator[None]:
    """Run a coroutine beside the block, and cancel it at its end; what failed in it is raised."""
    task = asyncio.create_task(work)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.wait({task})
        if not task.cancelled():
            task.result()


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
