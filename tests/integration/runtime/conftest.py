"""A bus that others can join, and a stranger who speaks Zenoh, but is none of ours."""

import asyncio
from collections.abc import AsyncIterator

import pytest_asyncio
import zenoh

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus


@pytest_asyncio.fixture
async def bus(endpoint: str) -> AsyncIterator[ZenohBus]:
    opened = await ZenohBus.open(Link(listen=(endpoint,)))
    yield opened
    await opened.close()


@pytest_asyncio.fixture
async def stranger(endpoint: str, bus: ZenohBus) -> AsyncIterator[zenoh.Session]:
    assert bus.connected
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    session = await asyncio.to_thread(zenoh.open, config)
    yield session
    await asyncio.to_thread(session.close)
