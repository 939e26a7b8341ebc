# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# (the stubs of zenoh leave return types out)
"""A stranger on the network, which speaks Zenoh, but is none of ours."""

import asyncio
from collections.abc import AsyncIterator

import pytest_asyncio
import zenoh

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus


@pytest_asyncio.fixture
async def bus_and_stranger(endpoint: str) -> AsyncIterator[tuple[ZenohBus, zenoh.Session]]:
    """Yield a bus that others can join, and a bare Zenoh session that joins it."""
    bus = await ZenohBus.open(Link(listen=(endpoint,)))
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    stranger = await asyncio.to_thread(zenoh.open, config)
    try:
        yield bus, stranger
    finally:
        await asyncio.to_thread(stranger.close)
        await bus.close()
