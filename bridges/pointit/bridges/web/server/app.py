"""Paths of the page's listeners: the ASGI application."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Sequence

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from pointit.bridges.web.server import access
from pointit.bridges.web.server.access import Access, RequestInfo
from pointit.bridges.web.server.bundle import Bundle, file_response, refusal
from pointit.bridges.web.server.security_middleware import SecurityMiddleware, asked_of
from pointit.bridges.web.wire import Role

ONWARDS = """<!doctype html><html lang="en"><meta charset="utf-8"><title>PointIt</title>
<meta http-equiv="refresh" content="0;url=/"><p><a href="/">Go on to the page</a></p></html>
"""
"""Served to visitors who follow a link of another site: a redirection would not send the strict cookie."""

NOT_ADMITTED = (
    "Open the link that PointIt printed where it was started, or the file that its log names; "
    "the link ends in ?token=... and lets you in."
)
BARRED = "Too many wrong links were opened from your address. Open the right one, which always lets you in."
REFUSAL_S = 1.0
"""Delay (s) of a refusal for an address that has guessed too often."""

PAST = "/ws/past"
"""Path of the websocket of pages that play the last minutes."""

OpenPage = Callable[[WebSocket, Role], Awaitable[None]]
Download = Callable[[Request], Awaitable[Response]]


def application(
    doors: Access, bundle: Bundle, open_page: OpenPage, download: Download, others: Sequence[BaseRoute] = ()
) -> ASGIApp:
    """Return the application.

    Args:
        doors: access control.
        bundle: the built page.
        open_page: serves a page's websocket, not yet accepted, until it ends.
        download: answers operators with the recording.
        others: further routes, which check access themselves.
    """
    page = _Page(doors, bundle, open_page, download)
    return SecurityMiddleware(
        Starlette(
            routes=[
                Route("/", page.index, methods=["GET"]),
                WebSocketRoute("/ws", page.socket),
                WebSocketRoute(PAST, page.socket),
                Route("/recording.mcap", page.recording, methods=["GET"]),
                *others,
                Route("/static/{name:path}", page.static, methods=["GET"]),
            ]
        ),
        doors,
    )


class _Page:
    """The routes of the page itself."""

    def __init__(self, doors: Access, bundle: Bundle, open_page: OpenPage, download: Download) -> None:
        self._doors = doors
        self._bundle = bundle
        self._open_page = open_page
        self._download = download

    async def index(self, request: Request) -> Response:
        asked, now_s = asked_of(request), time.monotonic()
        token = request.query_params.get("token")
        if token is not None:
            if self._doors.enter(token, asked, now_s) is None:
                return await self._refused(asked, now_s)
            # redirected, so that the token does not stay in the address bar
            response = HTMLResponse(ONWARDS) if asked.site == "cross-site" else RedirectResponse("/", 303)
            response.headers["Set-Cookie"] = access.cookie(asked, token)
            response.headers["Cache-Control"] = "no-store"
            return response
        if self._doors.admit(asked, now_s) is None:
            return await self._refused(asked, now_s)
        return file_response(request, self._bundle, "index.html")

    async def socket(self, socket: WebSocket) -> None:
        role = self._doors.admit(asked_of(socket), time.monotonic())
        if role is None:
            await self._slow_down(asked_of(socket))
            await socket.send_denial_response(PlainTextResponse(NOT_ADMITTED, 403))
        else:
            await self._open_page(socket, role)

    async def recording(self, request: Request) -> Response:
        role = self._doors.admit(asked_of(request), time.monotonic())
        if role != "operator":
            await self._slow_down(asked_of(request))
            return refusal(403, "Not permitted", "Open the page by the operator's link to take a recording.")
        return await self._download(request)

    async def static(self, request: Request) -> Response:
        return file_response(request, self._bundle, request.path_params["name"])

    async def _slow_down(self, asked: RequestInfo) -> None:
        if self._doors.is_rate_limited(asked.address, time.monotonic()):
            await asyncio.sleep(REFUSAL_S)

    async def _refused(self, asked: RequestInfo, now_s: float) -> Response:
        await self._slow_down(asked)
        if self._doors.is_rate_limited(asked.address, now_s):
            return refusal(429, "Not now", BARRED)
        return refusal(403, "This page needs a link", NOT_ADMITTED)
