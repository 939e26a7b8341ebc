"""One address at which an ASGI application is served, within this event loop.

uvicorn's protocols without its own loop: no signal handlers, no banner, nothing polled, and an end that does
not wait for clients that have stopped reading.
"""

import asyncio
import socket
import ssl
import sys
import weakref
from typing import Any

import uvicorn
from starlette.types import ASGIApp

from pointit.runtime import ListenError

MAX_MESSAGE = 16 * 1024
"""Bytes of a websocket message from a page, inflated; a longer one closes the connection."""

PING_S = 15.0
"""How often a websocket is asked whether it still reads, and how long it has to answer."""

CLOSE_S = 0.4
"""How long connections may take to close when the server ends; then they are cut."""

BACKLOG = 128

MOST_CONNECTIONS = 1024
"""At a time; further requests are answered with 503."""


def bind(host: str, port: int, option: str) -> socket.socket:
    """Return a socket that is bound to `port` of `host`; `option` is the parameter that names the port.

    Raises:
        ListenError: the port is taken, or the address is not this machine's; names both and what to do.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if sys.platform == "win32":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
    except (OSError, OverflowError) as error:
        listener.close()
        reason = getattr(error, "strerror", None) or str(error)
        raise ListenError(
            f"port {port} of {host} cannot be had for the page ({reason}); "
            f"end what uses it, or choose another with {option} (0: any that is free)"
        ) from error
    listener.setblocking(False)
    return listener


def url(scheme: str, host: str, port: int) -> str:
    """Return the address of what listens there, without a path."""
    return f"{scheme}://[{host}]:{port}" if ":" in host else f"{scheme}://{host}:{port}"


class Listener:
    """Serves `app` at a bound socket, by TLS where there is a context, from `start` to `close`."""

    def __init__(self, app: ASGIApp, bound: socket.socket, tls: ssl.SSLContext | None = None) -> None:
        self._socket = bound
        self.port: int = bound.getsockname()[1]
        """Where it listens."""
        config = uvicorn.Config(
            app,
            http="h11",
            loop="none",
            lifespan="off",
            log_config=None,
            log_level="critical",  # what clients do wrong is told in health; faults of ours by `app`
            access_log=False,
            proxy_headers=False,
            server_header=False,
            date_header=False,
            backlog=BACKLOG,
            limit_concurrency=MOST_CONNECTIONS,
            ws_max_size=MAX_MESSAGE,
            ws_per_message_deflate=True,
            ws_ping_interval=PING_S,
            ws_ping_timeout=PING_S,
        )
        config.load()
        config.ssl = tls
        self._server = uvicorn.Server(config)
        self._server.lifespan = config.lifespan_class(config)
        self._closing: weakref.WeakSet[Any] = weakref.WeakSet()
        self._is_open = False

    async def start(self) -> None:
        """Accept connections from now on."""
        await self._server.startup(sockets=[self._socket])
        self._is_open = True

    def cut_lingering(self) -> None:
        """Cut connections that should have closed by the last call and cannot: their clients read nothing."""
        for connection in list(self._server.server_state.connections):
            transport: asyncio.Transport | None = getattr(connection, "transport", None)
            if transport is None or not transport.is_closing():
                continue
            if connection in self._closing:
                transport.abort()
            else:
                self._closing.add(connection)

    async def close(self) -> None:
        """Accept nothing more and close every connection, or cut it."""
        if not self._is_open:
            self._socket.close()
            return
        self._is_open = False
        for server in self._server.servers:
            server.close()
        self._socket.close()
        state = self._server.server_state
        for connection in list(state.connections):
            connection.shutdown()
        tasks = set(state.tasks)
        if tasks:
            await asyncio.wait(tasks, timeout=CLOSE_S)
        for connection in list(state.connections):
            transport: asyncio.Transport | None = getattr(connection, "transport", None)
            if transport is not None:
                transport.abort()
        for task in state.tasks:
            task.cancel()
        if state.tasks:
            await asyncio.wait(set(state.tasks), timeout=CLOSE_S)
        await asyncio.sleep(0)  # connections that were cut are told in the next round of the loop
