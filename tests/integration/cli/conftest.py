"""A site on a free port for every test."""

from collections.abc import AsyncIterator

import pytest_asyncio

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import SERVICE_ALIVE
from tests.support.cli_site import Site
from tests.support.commands import change


@pytest_asyncio.fixture
async def site(endpoint: str) -> AsyncIterator[Site]:
    site = Site(bus=await ZenohBus.open(Link(listen=(endpoint,))), endpoint=endpoint)
    site.bus.watch(SERVICE_ALIVE, lambda name, *, present: change(site.present, name, here=present))
    try:
        yield site
    finally:
        await site.stop()
