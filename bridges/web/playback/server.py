"""A page server without a site, for one recording."""

import asyncio

from starlette.requests import Request
from starlette.responses import Response
from starlette.websockets import WebSocket

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.playback.file_past import FilePast
from pointit.bridges.web.playback.past_page import PastPage
from pointit.bridges.web.server import access as exposure_check
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.app import application
from pointit.bridges.web.server.bundle import Bundle, refusal
from pointit.bridges.web.server.listener import Listener, bind
from pointit.bridges.web.wire import Role
from pointit.runtime.host.extras import pointit_version

TICK_S = 1.0
"""Interval of checks for idle connections."""


class RecordingServer:
    """Serves a recording at one address. Each page has its own position."""

    def __init__(self, past: FilePast, config: WebConfig) -> None:
        """Bind the port of `config`, which has both tokens.

        Raises:
            ConfigError: If the page would be open to everyone.
            ListenError: If the port is taken.
        """
        exposure_check.check(config)
        self._past = past
        self._version = pointit_version()
        access = Access(config.operator_token, config.viewer_token)
        access.know_hosts([config.host])
        app = application(access, Bundle(), self._open, _no_download)
        self._listener = Listener(app, bind(config.host, config.port, "--port"))

    @property
    def port(self) -> int:
        """Return the port of the listener."""
        return self._listener.port

    async def start(self) -> None:
        """Accept pages."""
        await self._listener.start()

    async def run(self) -> None:
        """Read the recording and serve pages until cancelled."""
        try:
            await self._past.read()
            while True:
                await asyncio.sleep(TICK_S)
                self._listener.cut_lingering()
        finally:
            await self._listener.close()

    async def _open(self, socket: WebSocket, role: Role) -> None:  # noqa: ARG002 - nobody controls a past
        await PastPage(socket, self._past, version=self._version).run()


async def _no_download(_request: Request) -> Response:
    return refusal(404, "Not here", "This page plays a recording: its file is on the machine that serves it.")
