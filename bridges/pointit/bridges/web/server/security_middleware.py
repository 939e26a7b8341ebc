"""Middleware: checks hosts, origins and sizes of requests, and adds headers to responses."""

import logging

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from pointit.bridges.web.server import access
from pointit.bridges.web.server.access import Access, RequestInfo
from pointit.bridges.web.wire import OWN_FAULT

log = logging.getLogger(__name__)

MAX_BODY = 64 * 1024
"""Maximum size of a posted body."""


def asked_of(connection: HTTPConnection) -> RequestInfo:
    """Return the fields of a request that matter for access; see `SecurityMiddleware`."""
    asked: RequestInfo = connection.scope["pointit.asked"]
    return asked


class SecurityMiddleware:
    """Rejects requests made by other sites or under foreign names, and adds headers to all responses."""

    def __init__(self, app: ASGIApp, doors: Access) -> None:
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
                await PlainTextResponse(OWN_FAULT, 500)(scope, receive, telling)

    def _objection(self, scope: Scope, asked: RequestInfo) -> Response | None:
        if not self._doors.is_known_host(asked.host):
            return PlainTextResponse(
                "this is not an address of the page; open the link that PointIt has printed", 403
            )
        is_posted = scope["type"] == "http" and scope["method"] not in ("GET", "HEAD")
        if (scope["type"] == "websocket" or is_posted) and not self._doors.is_own_origin(asked):
            return PlainTextResponse("only a page of this server may do that", 403)
        if is_posted:
            length = Headers(scope=scope).get("content-length", "")
            if not length.isdecimal() or len(length) > 9 or int(length) > MAX_BODY:
                return PlainTextResponse(f"at most {MAX_BODY} bytes are accepted, with a Content-Length", 413)
        return None


def _asked(scope: Scope) -> RequestInfo:
    connection = HTTPConnection(scope)
    headers = connection.headers
    scheme, _, credentials = headers.get("authorization", "").partition(" ")
    return RequestInfo(
        scheme="https" if scope["scheme"] in ("https", "wss") else "http",
        host=headers.get("host", ""),
        address=connection.client.host if connection.client else "",
        origin=headers.get("origin", ""),
        site=headers.get("sec-fetch-site", ""),
        destination=headers.get("sec-fetch-dest", ""),
        cookies=connection.cookies,
        bearer=credentials.strip() if scheme.lower() == "bearer" else "",
    )
