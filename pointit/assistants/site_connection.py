"""The joined site, which may not be there yet, or be lost for a while."""

import asyncio
import contextlib
import logging
from collections.abc import AsyncGenerator, Callable
from contextlib import AbstractAsyncContextManager

from pointit.api.site import Site
from pointit.errors import ConnectError, PointItError

log = logging.getLogger(__name__)

RETRY_S = 2.0
"""Time between two attempts to join, s."""
FOREVER_S = 1e9


class SiteConnection:
    """Joins a site, again and again if need be, and gives it to tools while it is reachable."""

    def __init__(self, join: Callable[[], AbstractAsyncContextManager[Site]], where: str) -> None:
        """Join nothing yet. `where` names the site and its address in messages."""
        self._join = join
        self._site: Site | None = None
        self._why = f"{where} does not answer: start it, such as by `pointit run`, and ask again"

    @property
    def site(self) -> Site:
        """The site.

        Raises:
            ConnectError: If it is not reachable now.
        """
        if self._site is None:
            raise ConnectError(self._why)
        if self._site.problem:
            raise ConnectError(self._site.problem)
        return self._site

    @contextlib.asynccontextmanager
    async def opened(self) -> AsyncGenerator[None]:
        """Keep the site joined in this block."""
        task = asyncio.create_task(self._keep_joined(), name="site of assistants")
        try:
            yield
        finally:
            task.cancel()
            await asyncio.wait({task})

    async def _keep_joined(self) -> None:
        while True:
            try:
                async with self._join() as site:
                    _begin_receiving(site)
                    self._site = site
                    log.info("joined site %s", site.name)
                    await site.sleep(FOREVER_S)
            except PointItError as error:
                self._why = str(error)
                log.warning("%s", error)
            finally:
                self._site = None
            await asyncio.sleep(RETRY_S)


def _begin_receiving(site: Site) -> None:
    """Begin to receive what tools look up: it is there when the first one is called."""
    latest = site.latest
    for newest in (latest.cursor, latest.pose, latest.interaction, latest.objects, latest.robot):
        len(newest)
    latest.map.get("")
    latest.selection.get("")
