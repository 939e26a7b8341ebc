"""The participants of every kind of site."""

from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from tests.support.buses import KINDS, Site, site_of


@pytest_asyncio.fixture(params=KINDS)
async def site(request: pytest.FixtureRequest) -> AsyncIterator[Site]:
    async with site_of(request.param) as site:
        yield site
