"""A site on a bus in memory."""

from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from pointit.api.site import Site
from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock


@pytest_asyncio.fixture
async def site(bus: MemoryBus) -> AsyncIterator[Site]:
    async with Site.on(bus, WallClock()) as site:
        yield site


@pytest.fixture
def denied(bus: MemoryBus, monkeypatch: pytest.MonkeyPatch) -> None:
    async def deny(verb: str, topic: AnyTopic, name: str) -> str:
        return f"{verb} {topic.at(name)}"

    monkeypatch.setattr(bus, "denial_reason", deny)
    monkeypatch.setattr(MemoryBus, "is_restricted", True)
