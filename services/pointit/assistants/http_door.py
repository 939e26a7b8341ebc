"""Streamable HTTP on this machine, for callers with a token of the site's page."""

import asyncio
import contextlib
import time
from typing import Any

from mcp.server.auth.middleware.bearer_auth import AuthenticatedUser
from mcp.server.auth.provider import AccessToken
from mcp.server.mcpserver import MCPServer
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from pointit.assistants.tools import SCOPE_KEY
from pointit.bridges.web.server import exposure_check
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.app import REFUSAL_S, request_info
from pointit.bridges.web.server.listener import Listener, bind, url
from pointit.errors import ConfigError

PATH = "/mcp"
MAX_BODY = 64 * 1024
"""Limit of a request, bytes: no tool takes as much."""
MAX_SESSIONS = 64
TICK_S = 1.0
"""Interval of checks for idle connections, s."""
NEEDS_TOKEN = "a token of the page is needed: Authorization: Bearer ...; see docs/how-to/assistants.md\n"  # noqa: S105


class TokenMiddleware:
    """Lets requests in by the page's tokens: with its host, no foreign origin, as operator or viewer."""

    def __init__(self, app: ASGIApp, doors: Access) -> None:
        self._app = app
        self._doors = doors

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            return
        asked, now_s = request_info(scope), time.monotonic()
        role = self._doors.admit(asked, now_s) if asked.bearer else None
        if not self._doors.is_known_host(asked.host) or (
            asked.origin and not self._doors.is_own_origin(asked)
        ):
            await PlainTextResponse("only programs of this machine may ask", 403)(scope, receive, send)
        elif role not in ("operator", "viewer"):
            if self._doors.is_rate_limited(asked.address, now_s):
                await asyncio.sleep(REFUSAL_S)
            bearer = {"WWW-Authenticate": "Bearer"}
            await PlainTextResponse(NEEDS_TOKEN, 401, headers=bearer)(scope, receive, send)
        else:
            scope[SCOPE_KEY] = role
            # by this a session belongs to the role that began it
            scope["user"] = AuthenticatedUser(AccessToken(token="", client_id=role, scopes=[]))
            await self._app(scope, receive, send)


class HttpDoor:
    """Serves a server of the protocol at a port of this machine."""

    def __init__(self, server: MCPServer[Any], doors: Access, host: str, port: int) -> None:
        """Bind the port.

        Raises:
            ConfigError: If other machines could reach it.
            ListenError: If the port is taken.
        """
        if not exposure_check.is_loopback(host):
            raise ConfigError(
                f"--listen {host}:{port}: what goes there is not encrypted; listen at 127.0.0.1, and let "
                "other machines come through an SSH tunnel"
            )
        doors.know_hosts([host])
        app = server.streamable_http_app(
            streamable_http_path=PATH, max_request_body_size=MAX_BODY, max_sessions=MAX_SESSIONS, host=host
        )
        self._sessions = server.session_manager
        self._listener = Listener(TokenMiddleware(app, doors), bind(host, port, "--listen"))
        self.url = f"{url('http', host, self._listener.port)}{PATH}"
        """Address for clients."""

    async def run(self) -> None:
        """Serve until cancelled."""
        async with contextlib.AsyncExitStack() as stack:
            stack.push_async_callback(self._listener.close)
            await stack.enter_async_context(self._sessions.run())
            await self._listener.start()
            while True:
                await asyncio.sleep(TICK_S)
                self._listener.cut_lingering()
