"""The newest message of a topic, and a wait for one that fits; for commands that ask and look on."""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Generic, TypeVar

from pointit.runtime.bus import Bus
from pointit.schemas import Message
from pointit.schemas.topics import Topic

M = TypeVar("M", bound=Message)


def _any(_message: Message) -> bool:
    return True


class Newest(Generic[M]):
    """Follows one key."""

    def __init__(self, bus: Bus, topic: Topic[M], name: str = "") -> None:
        self.value: M | None = None
        self._changed = asyncio.Event()
        bus.subscribe(topic, self._on_message, name)

    async def wait(self, patience_s: float, fits: Callable[[M], bool] = _any) -> M | None:
        """Return the newest message as soon as it `fits`; none when none does within `patience_s`."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while self.value is None or not fits(self.value):
                    self._changed.clear()
                    await self._changed.wait()
        return self.value if self.value is not None and fits(self.value) else None

    def _on_message(self, message: M, _name: str) -> None:
        self.value = message
        self._changed.set()
