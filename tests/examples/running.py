"""An example that runs beside a test."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Coroutine
from typing import Any


@contextlib.asynccontextmanager
async def running(example: Coroutine[Any, Any, None]) -> AsyncGenerator[None]:
    """Run `example` in the block; it must not end before."""
    task = asyncio.create_task(example)
    try:
        yield
        assert not task.done(), task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
