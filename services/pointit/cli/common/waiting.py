"""Waiting for a site: the first message of a key, and a notice if something takes long."""

import asyncio
import contextlib
from collections.abc import Callable, Generator
from typing import Generic, TypeVar

import click

from pointit.runtime.bus.contract import Bus
from pointit.schemas import Message
from pointit.schemas.topics import Topic

PATIENCE_S = 2.0
"""Timeout of a site's first message, s."""

SILENT_S = 1.0
"""Wait after which a notice is printed, s."""

M = TypeVar("M", bound=Message)


@contextlib.contextmanager
def notify_if_slow(text: str) -> Generator[None]:
    """Print `text` to standard error if the block takes longer than `SILENT_S`."""

    def tell() -> None:
        click.echo(text, err=True)

    handle = asyncio.get_running_loop().call_later(SILENT_S, tell)
    try:
        yield
    finally:
        handle.cancel()


def _any(_message: Message) -> bool:
    return True


class LatestMessage(Generic[M]):
    """Holds the latest message of one key."""

    def __init__(self, bus: Bus, topic: Topic[M], name: str = "") -> None:
        self.value: M | None = None
        self._changed = asyncio.Event()
        bus.subscribe(topic, self._on_message, name)

    async def wait(self, patience_s: float, fits: Callable[[M], bool] = _any) -> M | None:
        """Return the newest message as soon as it `fits`, or None if none does within `patience_s`."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while self.value is None or not fits(self.value):
                    self._changed.clear()
                    await self._changed.wait()
        return self.value if self.value is not None and fits(self.value) else None

    def _on_message(self, message: M, _name: str) -> None:
        self.value = message
        self._changed.set()
