"""HTTP of the Model Context Protocol for callers with a token."""

import asyncio
import contextlib
import json
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, cast, get_args

from mcp.server.mcpserver import MCPServer
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from mcp.server.transport_security import RequestBodyLimitMiddleware
from mcp.types import InitializeRequest
from pydantic import ValidationError
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pointit.assistants.tools import SCOPE_KEY, Role
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.app import REFUSAL_S, request_info
from pointit.bridges.web.server.listener import HttpListener, open_port, url
from pointit.errors import ConfigError
from pointit.runtime.address_config import is_loopback
from pointit.runtime.config.validation_message import describe_validation_error

PATH = "/mcp"
MAX_BODY = 64 * 1024
"""Limit of a request, bytes: no tool takes as much."""
BODY_TIMEOUT_S = 10.0
"""Timeout of receiving the body of a request, s."""
MAX_SESSIONS = 32
"""Limit of sessions of each token: those of viewers take none of the operator's."""
SESSION_IDLE_S = 300.0
"""Time after which a session without a request or an open stream ends, s."""
MAX_REQUESTS = 128
"""Limit of simultaneous requests of each token: for each session its stream, and three calls."""
NEEDS_TOKEN = "a token of the page is needed: Authorization: Bearer ...; see docs/how-to/assistants.md\n"  # noqa: S105


class SlowBodyError(Exception):
    """The body of a request is not complete within `BODY_TIMEOUT_S`."""


class HandshakeCheck:
    """Refuses a malformed `initialize`, to which the library replies with an error and a session."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, whose body is complete."""
        messages = [await receive()]
        try:
            body: object = json.loads(messages[0].get("body", b""))
            if isinstance(body, dict) and cast("dict[str, Any]", body).get("method") == "initialize":
                InitializeRequest.model_validate(body)
        except ValidationError as error:
            text = f"initialize: {describe_validation_error(error, InitializeRequest)}\n"
            await PlainTextResponse(text, 400)(scope, receive, send)
            return
        except (ValueError, RecursionError):
            pass  # no JSON, which the library refuses

        async def replay() -> Message:
            return messages.pop() if messages else await receive()

        await self._app(scope, replay, send)


class TokenMiddleware:
    """Lets requests in by the page's tokens: with its host, no foreign origin, as operator or viewer."""

    def __init__(
        self, apps: Mapping[Role, ASGIApp], access: Access, follow_tokens: Callable[[], None]
    ) -> None:
        """Serve `apps` by role. `follow_tokens` gives `access` the present tokens before each request."""
        self._apps: dict[Role, ASGIApp] = {}
        for role, app in apps.items():
            self._apps[role] = RequestBodyLimitMiddleware(HandshakeCheck(app), MAX_BODY)
        self._access = access
        self._follow_tokens = follow_tokens
        self._requests: Counter[Role] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            return
        info = request_info(scope)
        now_s = time.monotonic()

        # Only a bearer token lets in, no cookie of the page alone
        self._follow_tokens()
        role = self._access.admit(info, now_s) if info.bearer else None
        is_foreign = bool(info.origin) and not self._access.is_own_origin(info)
        if is_foreign or not self._access.is_known_host(info.host):
            await PlainTextResponse("only programs of this machine may ask", 403)(scope, receive, send)
        elif role not in ("operator", "viewer"):
            if self._access.is_rate_limited(info.address, now_s):
                await asyncio.sleep(REFUSAL_S)
            bearer = {"WWW-Authenticate": "Bearer"}
            await PlainTextResponse(NEEDS_TOKEN, 401, headers=bearer)(scope, receive, send)
        elif self._requests[role] >= MAX_REQUESTS:
            text = f"{MAX_REQUESTS} requests with the {role}'s token are open, the limit: end some of them\n"
            await PlainTextResponse(text, 503)(scope, receive, send)
        else:
            scope[SCOPE_KEY] = role
            self._requests[role] += 1
            try:
                await self._apps[role](scope, _with_body_timeout(receive), send)
            except SlowBodyError:
                text = f"the request is not complete after {BODY_TIMEOUT_S:g} s: send it at once\n"
                await PlainTextResponse(text, 408)(scope, receive, send)
            finally:
                self._requests[role] -= 1


def _with_body_timeout(receive: Receive) -> Receive:
    """Return `receive`, which raises `SlowBodyError` while the body is incomplete for too long."""
    ends_s = asyncio.get_running_loop().time() + BODY_TIMEOUT_S
    is_complete = False

    async def timed() -> Message:
        nonlocal is_complete
        if is_complete:
            return await receive()
        try:
            async with asyncio.timeout_at(ends_s):
                message = await receive()
        except TimeoutError:
            raise SlowBodyError from None
        is_complete = not message.get("more_body", False)
        return message

    return timed


class HttpServer:
    """Serves a server of the protocol at a port of this machine."""

    def __init__(
        self,
        server: MCPServer[Any],
        access: Access,
        host: str,
        port: int,
        follow_tokens: Callable[[], None] = lambda: None,
    ) -> None:
        """Bind the port. `follow_tokens` is called before each request, and may change those of `access`.

        Raises:
            ConfigError: If other machines could reach it.
            ListenError: If the port is taken.
        """
        if not is_loopback(host):
            raise ConfigError(
                f"--listen {host}:{port}: what goes there is not encrypted; listen at 127.0.0.1, and let "
                "other machines come through an SSH tunnel"
            )
        access.know_hosts([host])

        # An application for each role: sessions of one role are unknown to the other one
        apps: dict[Role, ASGIApp] = {}
        self._managers: list[StreamableHTTPSessionManager] = []
        for role in get_args(Role):
            apps[role] = server.streamable_http_app(
                streamable_http_path=PATH,
                max_sessions=MAX_SESSIONS,
                session_idle_timeout=SESSION_IDLE_S,
                host=host,
            )
            self._managers.append(server.session_manager)
        self.app = TokenMiddleware(apps, access, follow_tokens)
        """ASGI application, which works while `run` does."""
        listening_socket = open_port(host, port, "--listen")
        self._listener = HttpListener(self.app, listening_socket)
        server_url = url("http", host, self._listener.port)
        self.url = f"{server_url}{PATH}"
        """Address for clients."""

    async def run(self) -> None:
        """Serve until cancelled."""
        async with contextlib.AsyncExitStack() as stack:
            stack.push_async_callback(self._listener.close)
            for manager in self._managers:
                await stack.enter_async_context(manager.run())
            await self._listener.start()
            await asyncio.Event().wait()
