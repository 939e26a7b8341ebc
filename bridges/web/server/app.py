"""The ASGI application of the listeners: paths, checks of requests, and the last minute as a file.

No core: it waits for requests.
"""

import asyncio
import io
import logging
import time
from collections.abc import Awaitable, Callable, Iterable, Sequence
from typing import IO

from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from pointit.bridges.web.playback.recent import Recent, RecentPast
from pointit.bridges.web.server.access import PROXY_HELP, Access, RequestInfo, cookie, headers, socket_problem
from pointit.bridges.web.server.bundle import Bundle, Pieces, file_response, refusal
from pointit.bridges.web.wire import OWN_FAULT, Role
from pointit.recording.head import make_head
from pointit.runtime.clock import Clock
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import Delivery, Topic

log = logging.getLogger(__name__)

OpenPage = Callable[[WebSocket, Role], Awaitable[None]]
Download = Callable[[Request], Awaitable[Response]]

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
MAX_BODY = 64 * 1024
"""Maximum size of a posted body."""


def write_recording(past: RecentPast, since_ns: int, output: IO[bytes]) -> int:
    """Write what happened since `since_ns`, beginning with the states and presences of then.

    Slow: call it in a thread.

    Returns:
        the number of entries.
    """
    from pointit.recording.writer import RecordingWriter  # noqa: PLC0415 - 1 MB, only for downloads

    writer = RecordingWriter(output, make_head(past.site, since_ns))
    for entry in past.states_at(since_ns - 1):
        if not isinstance(entry.row, Topic) or entry.row.delivery is Delivery.STATE:
            writer.add(entry._replace(time_ns=since_ns))
    for entry in past.entries(since_ns - 1):
        writer.add(entry)
    writer.close()
    return writer.entries


def file_name(site: str, now_ns: int) -> str:
    """Return the file's name."""
    return f"pointit-{site}-{now_ns // NS_PER_S}.mcap"


class Downloads:
    """Writes recordings on request, one at a time."""

    def __init__(self, recent: Recent, window_s: float, clock: Clock) -> None:
        self._recent = recent
        self._window_ns = round(window_s * NS_PER_S)
        self._clock = clock
        self._writing: asyncio.Task[tuple[str, bytes]] | None = None

    async def answer(self, _request: Request) -> Response:
        """Return the last minute as a file. A request during writing gets that file."""
        if self._writing is None or self._writing.done():
            self._writing = asyncio.create_task(self._write_file(), name="web writes a recording")
        name, content = await asyncio.shield(self._writing)  # others may wait for it, too
        headers = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
        return Pieces(content, headers=headers, media_type="application/octet-stream")

    def close(self) -> None:
        """Cancel the writing."""
        if self._writing is not None:
            self._writing.cancel()

    async def _write_file(self) -> tuple[str, bytes]:
        now_ns = self._clock.now_ns()
        output = io.BytesIO()
        past = self._recent.past(now_ns)
        since_ns = max(past.began_ns, now_ns - self._window_ns)
        await asyncio.to_thread(write_recording, past, since_ns, output)
        return file_name(past.site, now_ns), output.getvalue()


def application(
    access: Access, bundle: Bundle, open_page: OpenPage, download: Download, others: Sequence[BaseRoute] = ()
) -> ASGIApp:
    """Return the application; `open_page` serves a websocket, not yet accepted, until it ends.

    Routes of `others` check access themselves.
    """
    page = _Page(access, bundle, open_page, download)
    routes = [
        Route("/", page.index, methods=["GET"]),
        WebSocketRoute("/ws", page.socket),
        Route("/ws", page.socket_problem, methods=["GET"]),
        WebSocketRoute(PAST, page.socket),
        Route("/recording.mcap", page.recording, methods=["GET"]),
        *others,
        Route("/static/{name:path}", page.static, methods=["GET"]),
    ]
    return SecurityMiddleware(Starlette(routes=routes, exception_handlers={404: _not_found}), access)


async def _not_found(_request: Request, _error: Exception) -> Response:
    return refusal(404, "There is no such page", "Check its address, or open the link that PointIt printed.")


class _Page:
    def __init__(self, access: Access, bundle: Bundle, open_page: OpenPage, download: Download) -> None:
        self._access = access
        self._bundle = bundle
        self._open_page = open_page
        self._download = download

    async def index(self, request: Request) -> Response:
        info = info_of(request)
        now_s = time.monotonic()
        token = request.query_params.get("token")
        if token is not None:
            if self._access.enter(token, info, now_s) is None:
                return await self._refuse(info, now_s)
            # redirected, so that the token does not stay in the address bar
            if info.site == "cross-site":
                response: Response = HTMLResponse(ONWARDS)
            else:
                response = RedirectResponse("/", 303)
            response.headers["Set-Cookie"] = cookie(info, token)
            response.headers["Cache-Control"] = "no-store"
            return response
        if self._access.admit(info, now_s) is None:
            return await self._refuse(info, now_s)
        return file_response(request, self._bundle, "index.html")

    async def socket(self, socket: WebSocket) -> None:
        info = info_of(socket)
        role = self._access.admit(info, time.monotonic())
        if role is None:
            await self._slow_down(info)
            await socket.send_denial_response(PlainTextResponse(NOT_ADMITTED, 403))
        else:
            await self._open_page(socket, role)

    async def socket_problem(self, request: Request) -> Response:
        """Say why the page gets no websocket: the browser shows it nothing of a refusal."""
        info = info_of(request)
        if self._access.admit(info, time.monotonic()) is None:
            await self._slow_down(info)
            return PlainTextResponse(NOT_ADMITTED, 403)
        origin = request.query_params.get("page", "")
        return PlainTextResponse(socket_problem(info, origin))

    async def recording(self, request: Request) -> Response:
        info = info_of(request)
        role = self._access.admit(info, time.monotonic())
        if role != "operator":
            await self._slow_down(info)
            return refusal(403, "Not permitted", "Open the page by the operator's link to take a recording.")
        return await self._download(request)

    async def static(self, request: Request) -> Response:
        return file_response(request, self._bundle, request.path_params["name"])

    async def _slow_down(self, info: RequestInfo) -> None:
        if self._access.is_rate_limited(info.address, time.monotonic()):
            await asyncio.sleep(REFUSAL_S)

    async def _refuse(self, info: RequestInfo, now_s: float) -> Response:
        await self._slow_down(info)
        if self._access.is_rate_limited(info.address, now_s):
            return refusal(429, "Not now", BARRED)
        return refusal(403, "This page needs a link", NOT_ADMITTED)


def info_of(connection: HTTPConnection) -> RequestInfo:
    """Return the fields of a request that matter for access; see `SecurityMiddleware`."""
    info: RequestInfo = connection.scope["pointit.request_info"]
    return info


class SecurityMiddleware:
    """Rejects requests made by other sites or under foreign names, and adds headers to all responses."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request or websocket."""
        if scope["type"] not in ("http", "websocket"):
            return
        host = Headers(scope=scope).get("host", "")
        scope["scheme"] = self._access.scheme(scope["scheme"], host)
        info = request_info(scope)
        scope["pointit.request_info"] = info
        answered = False

        # A response that has a header of its own keeps it
        async def send_with_headers(message: Message) -> None:
            nonlocal answered
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                answered = True
                message["headers"] = _with_security_headers(message.get("headers", ()), info)
            elif message["type"] in ("websocket.accept", "websocket.close"):
                answered = True
            await send(message)

        response = self._objection(scope, info)
        try:
            if response is None:
                await self._app(scope, receive, send_with_headers)
            elif scope["type"] == "http":
                await response(scope, receive, send_with_headers)
            else:
                await WebSocket(scope, receive, send_with_headers).send_denial_response(response)
        except OSError:
            pass  # the client has gone
        except Exception:
            log.exception("%s failed", scope["path"])
            if not answered and scope["type"] == "http":
                failure = PlainTextResponse(OWN_FAULT, 500)
                await failure(scope, receive, send_with_headers)

    def _objection(self, scope: Scope, info: RequestInfo) -> Response | None:
        """Return the refusal of a request under a foreign name, of another site, or too long, else None."""
        if not self._access.is_known_host(info.host):
            return PlainTextResponse(
                "this is not an address of the page; open the link that PointIt has printed. Behind a proxy, "
                f"set web.public_url to its address. {PROXY_HELP}",
                403,
            )
        is_posted = scope["type"] == "http" and scope["method"] not in ("GET", "HEAD")
        is_foreign = not self._access.is_own_origin(info)
        if scope["type"] == "websocket" and is_foreign:
            return PlainTextResponse(socket_problem(info, info.origin), 403)
        if is_posted and is_foreign:
            return PlainTextResponse("only a page of this server may do that", 403)

        # By its own statement: a body is read into memory at once
        if is_posted:
            length = Headers(scope=scope).get("content-length", "")
            is_number = length.isdecimal() and len(length) <= 9
            if not is_number or int(length) > MAX_BODY:
                return PlainTextResponse(f"at most {MAX_BODY} bytes are accepted, with a Content-Length", 413)
        return None


def _with_security_headers(
    own_headers: Iterable[tuple[bytes, bytes]], info: RequestInfo
) -> list[tuple[bytes, bytes]]:
    all_headers = list(own_headers)
    own_names = {name.lower() for name, _ in all_headers}
    for name, value in headers(info).items():
        encoded_name = name.lower().encode()
        if encoded_name not in own_names:
            all_headers.append((encoded_name, value.encode()))
    return all_headers


def request_info(scope: Scope) -> RequestInfo:
    """Return the fields of a request that matter for access."""
    connection = HTTPConnection(scope)
    headers = connection.headers
    scheme = "https" if scope["scheme"] in ("https", "wss") else "http"
    address = connection.client.host if connection.client else ""
    bearer = ""
    kind, _, credentials = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer":
        bearer = credentials.strip()
    return RequestInfo(
        scheme=scheme,
        host=headers.get("host", ""),
        address=address,
        origin=headers.get("origin", ""),
        site=headers.get("sec-fetch-site", ""),
        destination=headers.get("sec-fetch-dest", ""),
        cookies=connection.cookies,
        bearer=bearer,
    )
