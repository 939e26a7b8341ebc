"""Open requests to ROS services."""

import asyncio
from collections.abc import Coroutine
from typing import Any

from pointit.runtime.errors import BusClosedError


class Calls:
    """The open requests of one backend, which close with it."""

    def __init__(self) -> None:
        self._open: set[asyncio.Task[bytes]] = set()

    async def answered(self, call: Coroutine[Any, Any, bytes], name: str) -> bytes:
        """Await `call` as a task called `name`, and return its result.

        Raises:
            BusClosedError: If `close` was called meanwhile.
        """
        task = asyncio.get_running_loop().create_task(call, name=name)
        self._open.add(task)
        task.add_done_callback(self._forget)
        try:
            await asyncio.wait([task])
        finally:
            task.cancel()
        if task.cancelled():
            raise BusClosedError("the backend was closed while it waited for an answer")
        return task.result()

    def close(self) -> None:
        """Cancel all requests."""
        for task in self._open:
            task.cancel()

    def _forget(self, task: asyncio.Task[bytes]) -> None:
        self._open.discard(task)
        if not task.cancelled():
            task.exception()  # retrieved: the caller may have gone
