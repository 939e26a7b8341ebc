"""Pages of the running site that look at its last minutes."""

from starlette.websockets import WebSocket

from pointit.bridges.web.pages.open_pages import Pages
from pointit.bridges.web.playback.past_page import PastPage
from pointit.bridges.web.playback.recent import Recent
from pointit.runtime.clock import Clock
from pointit.schemas.topics import Presence

JUST_S = 15.0
"""Distance of the first position from the end, s."""


class Visits:
    """Opens pages with a playback of `recent`."""

    def __init__(self, recent: Recent, pages: Pages, clock: Clock, version: str) -> None:
        """Store the parts; `version` is PointIt's."""
        self._recent = recent
        self._pages = pages
        self._clock = clock
        self._version = version

    def remember(self, row: Presence, name: str, present: bool) -> None:  # noqa: FBT001 - as on the bus
        """Keep a change of presence."""
        self._recent.add(self._clock.now_ns(), row, name, present, b"1" if present else b"")

    async def open(self, socket: WebSocket) -> None:
        """Serve a page until it leaves, unless there are too many pages."""
        if self._pages.is_full:
            await self._pages.refuse(socket)
            return
        past = self._recent.past(self._clock.now_ns())
        start_s = max(past.timeline().length_s - JUST_S, 0.0)
        with self._pages.elsewhere():
            await PastPage(socket, past, version=self._version, start_s=start_s).run()
