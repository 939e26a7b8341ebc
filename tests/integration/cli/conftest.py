"""A site on a free port for every test."""

from collections.abc import AsyncIterator

import pytest_asyncio

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import SERVICE_ALIVE
from tests.support.cli_site import Site


@pytest_asyncio.fixture
async def site(endpoint: str) -> AsyncIterator[Site]:
    site = Site(bus=await ZenohBus.open(Link(listen=(endpoint,))), endpoint=endpoint)

    def on_presence(instance: str, here: bool) -> None:  # noqa: FBT001 - the bus's signature
        (site.present.add if here else site.present.discard)(instance)

    site.bus.watch(SERVICE_ALIVE, on_presence)
    try:
        yield site
    finally:
        await site.stop()
