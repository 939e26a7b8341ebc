"""What is at which path, and who is let through: the ASGI application of the page's listeners."""

import logging
import time
from collections.abc import Awaitable, Callable, Sequence
from html import escape
from typing import Any

from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from pointit.bridges.web import access
from pointit.bridges.web.access import Access, Asked
from pointit.bridges.web.bundle import Bundle
from pointit.bridges.web.wire import Role

log = logging.getLogger(__name__)

MOST_BODY = 64 * 1024
"""Bytes that may be posted."""

REFUSED = """<!doctype html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>PointIt</title>
<h1>{title}</h1><p>{sentence}</p></html>
"""

ONWARDS = """<!doctype html><html lang="en"><meta charset="utf-8"><title>PointIt</title>
<meta http-equiv="refresh" content="0;url=/"><p><a href="/">Go on to the page</a></p></html>
"""
"""For who comes by a link of another site: a redirection would not send the cookie, which is strict."""

NOT_ADMITTED = (
    "Open the link that PointIt has printed where it was started; it ends in ?token=... and lets you in."
)
BARRED = "Too many wrong links came from your address: wait a minute, then open the right one."

OpenPage = Callable[[WebSocket, Role], Awaitable[None]]
Download = Callable[[Request], Awaitable[Response]]


def asked_of(connection: HTTPConnection) -> Asked:
    """Return what of a request matters for access; `Guard` has put it there."""
    asked: Asked = connection.scope["pointit.asked"]
    return asked


def application(
    doors: Access, bundle: Bundle, open_page: OpenPage, download: Download, others: Sequence[BaseRoute] = ()
) -> ASGIApp:
    """Return the application.

    Args:
        doors: who is let in.
        bundle: the built page.
        open_page: serves a page's websocket, which is not accepted yet, until it ends.
        download: answers who may control with the recording.
        others: further routes; whom they let in is their business.
    """
    page = _Page(doors, bundle, open_page, download)
    return Guard(
        Starlette(
            routes=[
                Route("/", page.index, methods=["GET"]),
                WebSocketRoute("/ws", page.socket),
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
                return self._refused(asked, now_s)
            # elsewhere, so that the token is not to be seen in the address bar
            response = HTMLResponse(ONWARDS) if asked.site == "cross-site" else RedirectResponse("/", 303)
            response.headers["Set-Cookie"] = access.cookie(asked, token)
            response.headers["Cache-Control"] = "no-store"
            return response
        if self._doors.admit(asked, now_s) is None:
            return self._refused(asked, now_s)
        return file_response(request, self._bundle, "index.html")

    async def socket(self, socket: WebSocket) -> None:
        role = self._doors.admit(asked_of(socket), time.monotonic())
        if role is None:
            await socket.send_denial_response(PlainTextResponse(NOT_ADMITTED, 403))
        else:
            await self._open_page(socket, role)

    async def recording(self, request: Request) -> Response:
        role = self._doors.admit(asked_of(request), time.monotonic())
        if role != "operator":
            return refusal(403, "Not for you", "Open the page by the operator's link to take a recording.")
        return await self._download(request)

    async def static(self, request: Request) -> Response:
        return file_response(request, self._bundle, request.path_params["name"])

    def _refused(self, asked: Asked, now_s: float) -> Response:
        if self._doors.is_barred(asked.address, now_s):
            return refusal(429, "Not now", BARRED)
        return refusal(403, "This page is not open to everybody", NOT_ADMITTED)


def refusal(status: int, title: str, sentence: str) -> Response:
    """Return a page of one sentence that says why not."""
    return HTMLResponse(
        REFUSED.format(title=escape(title), sentence=escape(sentence)),
        status,
        headers={"Cache-Control": "no-store"},
    )


def file_response(request: Request, bundle: Bundle, name: str) -> Response:
    """Return a file of the bundle; nothing but a word when the browser has the very same already."""
    file = bundle.file(name)
    if file is None:
        if name == "index.html":
            return refusal(
                503, "The page is not built", "Build it: npm run build in bridges/pointit/bridges/web/client."
            )
        return PlainTextResponse("there is no such file", 404)
    headers = {"ETag": file.etag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if file.etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    content = file.content
    if file.compressed and "gzip" in request.headers.get("accept-encoding", ""):
        content, headers["Content-Encoding"] = file.compressed, "gzip"
    return Response(content, headers=headers, media_type=file.media_type)


class Guard:
    """Lets nothing through that another site or name had a hand in, and puts the headers on all answers."""

    def __init__(self, app: ASGIApp, doors: Access) -> None:
        """Stand before `app`."""
        self._app = app
        self._doors = doors

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request or websocket."""
        if scope["type"] not in ("http", "websocket"):
            return
        asked = _asked(scope)
        scope["pointit.asked"] = asked
        answered = False

        async def telling(message: Message) -> None:
            nonlocal answered
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                answered = True
                own = {name.lower() for name, _ in message.get("headers", ())}
                more = [
                    (name.lower().encode(), value.encode()) for name, value in access.headers(asked).items()
                ]
                message["headers"] = [*message.get("headers", ()), *(h for h in more if h[0] not in own)]
            elif message["type"] in ("websocket.accept", "websocket.close"):
                answered = True
            await send(message)

        response = self._objection(scope, asked)
        try:
            if response is None:
                await self._app(scope, receive, telling)
            elif scope["type"] == "http":
                await response(scope, receive, telling)
            else:
                await WebSocket(scope, receive, telling).send_denial_response(response)
        except OSError:
            pass  # the client has gone
        except Exception:
            log.exception("%s failed", scope["path"])
            if not answered and scope["type"] == "http":
                await PlainTextResponse("a fault of PointIt itself, see its log", 500)(
                    scope, receive, telling
                )

    def _objection(self, scope: Scope, asked: Asked) -> Response | None:
        if not self._doors.is_known_host(asked.host):
            return PlainTextResponse(
                "this is no address of the page; open the link that PointIt has printed", 403
            )
        is_posted = scope["type"] == "http" and scope["method"] not in ("GET", "HEAD")
        if (scope["type"] == "websocket" or is_posted) and not self._doors.is_own_origin(asked):
            return PlainTextResponse("only a page of this very server may do that", 403)
        if is_posted:
            length = Headers(scope=scope).get("content-length", "")
            if not length.isdecimal() or len(length) > 9 or int(length) > MOST_BODY:
                return PlainTextResponse(f"at most {MOST_BODY} bytes are taken, and their number first", 413)
        return None


def _asked(scope: dict[str, Any] | Scope) -> Asked:
    connection = HTTPConnection(scope)
    headers = connection.headers
    return Asked(
        scheme="https" if scope["scheme"] in ("https", "wss") else "http",
        host=headers.get("host", ""),
        address=connection.client.host if connection.client else "",
        origin=headers.get("origin", ""),
        site=headers.get("sec-fetch-site", ""),
        destination=headers.get("sec-fetch-dest", ""),
        cookies=connection.cookies,
    )
