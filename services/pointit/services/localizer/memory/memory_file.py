"""File of what is remembered of a person, in the state directory of the localizer's machine."""

import asyncio
from collections.abc import Sequence

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import StateFile, state_directory
from pointit.schemas import LearntPointing, SchemaModel
from pointit.schemas.base import Many
from pointit.schemas.topics import check_name

TOPIC = "memory"
"""Topic of the warnings."""


class StoredMemory(SchemaModel):
    """Memory of a person as stored."""

    learnt: Many[LearntPointing] = ()


def memory_file(user: str) -> StateFile[StoredMemory]:
    """Return the file of `user` on this machine. Touches nothing yet.

    Raises:
        KeyNameError: If `user` cannot be a name.
    """
    return StateFile[StoredMemory].at(
        state_directory() / "users" / check_name(user, "user") / "memory.json", StoredMemory
    )


class MemoryFile:
    """Reads, writes and erases the memory, with warnings in Health; writes in the background."""

    def __init__(self, user: str, bus: ServiceBus) -> None:
        self._user = user
        self._bus = bus
        self._file = memory_file(user)
        self._newest: StoredMemory | None = None
        """To be written. None: nothing."""
        self._has_news = asyncio.Event()
        self._using = asyncio.Lock()

    def read(self) -> tuple[LearntPointing, ...]:
        """Return the stored memory, empty if it cannot be used."""
        try:
            stored = self._file.read()
        except ConfigError as error:
            self._bus.warn(TOPIC, f"what is remembered of {self._user}'s pointing is not used: {error}")
            return ()
        return () if stored is None else stored.learnt

    def put(self, learnt: Sequence[LearntPointing]) -> None:
        """Write `learnt` soon; `keep` must run."""
        self._newest = StoredMemory(learnt=tuple(learnt))
        self._has_news.set()

    async def keep(self) -> None:
        """Write what is put, until cancelled; nothing is lost then."""
        try:
            while True:
                await self._has_news.wait()
                self._has_news.clear()
                async with self._using:
                    newest, self._newest = self._newest, None
                    self._show(await asyncio.to_thread(self._problem, newest))
        finally:
            self._show(self._problem(self._newest))

    async def erase(self) -> str:
        """Erase the file, whatever was put before; return the result as a sentence."""
        self._newest = None  # at once: what is put from now on is kept
        async with self._using:
            try:
                was_there = await asyncio.to_thread(self._file.erase)
            except ConfigError as error:
                return f"it is forgotten, but a restart recalls it: {error}"
        self._bus.clear(TOPIC)
        return "it is forgotten" if was_there else "nothing was remembered"

    def _problem(self, memory: StoredMemory | None) -> str:
        """Write `memory`, unless it is None. Return the problem, or `""`."""
        try:
            if memory is not None:
                self._file.write(memory)
        except ConfigError as error:
            return str(error)
        return ""

    def _show(self, problem: str) -> None:
        lost = f"what was learnt of {self._user}'s pointing is lost at the end: {problem}"
        self._bus.warn(TOPIC, lost if problem else "")
