"""Requests of ours to ROS services that are not answered yet."""

import asyncio
from collections.abc import Coroutine
from typing import Any

from pointit.runtime.errors import BusClosedError


class Calls:
    """All of one backend, whose end is theirs."""

    def __init__(self) -> None:
        """Begin with none."""
        self._open: set[asyncio.Task[bytes]] = set()

    async def answered(self, call: Coroutine[Any, Any, bytes], name: str) -> bytes:
        """Return what `call` returns, or raise what it raises; `name` is its task's.

        Raises:
            BusClosedError: `close` was called meanwhile.
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
        """Wait for none of them any longer."""
        for task in self._open:
            task.cancel()

    def _forget(self, task: asyncio.Task[bytes]) -> None:
        self._open.discard(task)
        if not task.cancelled():
            task.exception()  # seen: whoever asked may have gone
