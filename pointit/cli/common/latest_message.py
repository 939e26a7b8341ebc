"""The latest message of a key, for commands that wait for one."""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Generic, TypeVar

from pointit.runtime.bus.contract import Bus
from pointit.schemas import Message
from pointit.schemas.topics import Topic

M = TypeVar("M", bound=Message)


def _any(_message: Message) -> bool:
    return True


class LatestMessage(Generic[M]):
    """Holds the latest message of one key."""

    def __init__(self, bus: Bus, topic: Topic[M], name: str = "") -> None:
        self.value: M | None = None
        self._changed = asyncio.Event()
        bus.subscribe(topic, self._on_message, name)

    async def wait(self, timeout_s: float, fits: Callable[[M], bool] = _any) -> M | None:
        """Return the newest message as soon as it `fits`, or None if none does within `timeout_s`."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.value is None or not fits(self.value):
                    self._changed.clear()
                    await self._changed.wait()
        if self.value is None or not fits(self.value):
            return None
        return self.value

    async def wait_for_next(self) -> M:
        """Return the next message that arrives."""
        self._changed.clear()
        await self._changed.wait()
        assert self.value is not None  # noqa: S101 - the wait above ends with it
        return self.value

    def _on_message(self, message: M, _name: str, /) -> None:
        self.value = message
        self._changed.set()
