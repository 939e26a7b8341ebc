"""The site of an assistant: not there yet, lost, wrong, and back."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator

import pytest

from pointit.api.site import Site
from pointit.assistants.site_connection import SiteConnection
from pointit.errors import ConnectError, PointItError, WrongSiteError
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import VirtualClock
from tests.support.bench import until

ABSENT = "site lab at tcp/hall:7447 does not answer"


class Joiner:
    """Joins a site in memory as often as there is one, and fails before if it is told to."""

    def __init__(self) -> None:
        self.is_there = asyncio.Event()
        self.failures: list[PointItError] = []
        self.bus: MemoryBus | None = None
        self.door = SiteConnection(self.join, "site lab at tcp/hall:7447")

    @contextlib.asynccontextmanager
    async def join(self) -> AsyncGenerator[Site]:
        await self.is_there.wait()
        if self.failures:
            raise self.failures.pop()
        self.bus = MemoryBus()
        try:
            async with Site.on(self.bus, VirtualClock()) as site:
                yield site
        finally:
            await self.bus.close()

    def why(self) -> str:
        """Return the reason for which there is no site, or `""`."""
        with contextlib.suppress(ConnectError):
            return self.door.site.problem
        with pytest.raises(ConnectError) as raised:
            _ = self.door.site
        return str(raised.value)


async def test_a_site_that_comes_later_is_joined() -> None:
    joiner = Joiner()
    async with joiner.door.opened():
        await asyncio.sleep(1000)
        assert joiner.why().startswith(ABSENT)
        joiner.is_there.set()
        await until(lambda: not joiner.why())


async def test_a_wrong_site_is_named_until_the_right_one_is_there() -> None:
    joiner = Joiner()
    joiner.failures.append(WrongSiteError("there is site hall"))
    joiner.is_there.set()
    async with joiner.door.opened():
        await until(lambda: joiner.why() == "there is site hall")
        await until(lambda: not joiner.why())


async def test_a_site_that_ends_is_joined_again() -> None:
    joiner = Joiner()
    joiner.is_there.set()
    async with joiner.door.opened():
        await until(lambda: not joiner.why())
        assert joiner.bus is not None
        joiner.is_there.clear()
        joiner.door.site.fail(PointItError("a service has failed"))
        await until(lambda: joiner.why() == "a service has failed")
        joiner.is_there.set()
        await until(lambda: not joiner.why())


async def test_a_lost_connection_is_said_in_its_words(monkeypatch: pytest.MonkeyPatch) -> None:
    joiner = Joiner()
    joiner.is_there.set()
    async with joiner.door.opened():
        await until(lambda: not joiner.why())
        monkeypatch.setattr(MemoryBus, "problem", "router at tcp/hall:7447 is lost")
        with pytest.raises(ConnectError, match="is lost"):
            _ = joiner.door.site
        monkeypatch.undo()
        assert not joiner.why()
