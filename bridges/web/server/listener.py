"""One address at which an ASGI application is served, within this event loop.

uvicorn's protocols without its own loop: no signal handlers, no banner, no polling, and closing does not wait
for clients that have stopped reading.

No core: it waits for connections.
"""

import asyncio
import contextlib
import errno
import functools
import itertools
import logging
import socket
import ssl
import sys
from collections import Counter, OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from pointit.bridges.web.server.paced_websocket import PacedWebSocket
from pointit.runtime.address_config import format_address
from pointit.runtime.errors import ListenError
from pointit.runtime.host.name_lookup import resolve
from pointit.schemas.text import system_reason

log = logging.getLogger(__name__)

MAX_MESSAGE = 16 * 1024
"""Maximum size of a websocket message from a page, inflated, bytes; a longer one closes the connection."""

PING_S = 5.0
"""Interval and timeout of websocket pings, s. A vanished page holds a wrist for at most twice as long."""

CLOSE_S = 0.4
"""Timeout (s) of closing connections when the server ends; then they are cut."""

BACKLOG = 128

MAX_CONNECTIONS = 1024
"""Maximum number of connections, or a quarter of the files that this process may open. A further one replaces
the one that has been idle longest, else has not read longest, of the address that has most."""

MAX_ARRIVING = 64
"""Maximum number of TLS handshakes in progress, and of connections that have sent nothing yet. A further
one replaces the oldest of the address that has most."""

AT_ONCE = 32
"""Number of connections that are accepted before anything else is done."""

ARRIVING_S = 10.0
"""Timeout of a TLS handshake, s."""

QUIET_S = 10.0
"""A connection without a request, or without reading its response, for this long (s) is cut."""

CUT_PERIOD_S = 1.0

REST_S = 0.5
"""Pause (s) in accepting when the system cannot take another connection."""


def open_port(host: str, port: int, option: str) -> socket.socket:
    """Return a socket that listens at `port` of `host`; `option` is the parameter that names the port.

    Clients that come before `Listener.start` wait: an address that was printed is never refused.

    Raises:
        ListenError: If the port is taken, or the address is not this machine's; names both and what to do.
    """
    listener = None
    try:
        family, address = resolve(host, port, socket.SOCK_STREAM)[0]
        # Without the protocol, asyncio leaves Nagle's algorithm on in connections: the second part of each
        # response would wait for the delayed acknowledgement of the first one, 40 ms on Linux
        listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        # On Windows, an address that may be reused is one that another process may take over
        if sys.platform == "win32":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(BACKLOG)
    except (OSError, OverflowError) as error:
        if listener is not None:
            listener.close()
        if isinstance(error, OSError) and error.errno == errno.EADDRNOTAVAIL:
            raise ListenError(
                f"the page cannot listen at {host}, which is no address of this machine: write one that is, "
                "or leave it empty"
            ) from error
        raise ListenError(
            f"port {port} of {host} is not available for the page ({system_reason(error)}); "
            f"end what uses it, or choose another with {option} (0: any that is free)"
        ) from error
    listener.setblocking(False)
    return listener


def url(scheme: str, host: str, port: int) -> str:
    """Return the address of a listener, without a path."""
    return f"{scheme}://{format_address(host, port)}"


def default_max_connections() -> int:
    """Return a listener's maximum number of connections, which leaves files for the rest of the process."""
    if sys.platform == "win32":
        return MAX_CONNECTIONS
    import resource  # noqa: PLC0415 - there is none on Windows

    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if files == resource.RLIM_INFINITY:
        return MAX_CONNECTIONS
    return max(16, min(MAX_CONNECTIONS, files // 4))


@dataclass(slots=True)
class _Visit:
    address: str
    """IP address of the client."""
    cycle: object = None
    """Its newest request, or None."""
    owed: int = 0
    """Bytes that it has not read."""
    since_s: float = 0.0
    """Time since when that is so."""


class HttpListener:
    """Serves `app` at a socket of `open_port`, with TLS if there is a context, from `start` to `close`."""

    def __init__(
        self,
        app: ASGIApp,
        listening: socket.socket,
        tls: ssl.SSLContext | None = None,
        *,
        max_connections: int = 0,
    ) -> None:
        """Create it without accepting. `max_connections`: 0: `default_max_connections`."""
        self._socket = listening
        self.port: int = listening.getsockname()[1]
        """Port of the listener."""
        self._config = uvicorn.Config(
            app,
            http="h11",
            loop="none",
            lifespan="off",
            log_config=None,
            log_level="critical",  # errors of clients are reported in health, own faults by `app`
            access_log=False,
            proxy_headers=False,
            server_header=False,
            date_header=False,
            ws=PacedWebSocket,
            ws_max_size=MAX_MESSAGE,
            ws_per_message_deflate=True,
            ws_ping_interval=PING_S,
            ws_ping_timeout=PING_S,
        )
        self._config.load()
        self._tls = tls
        self._max_connections = max_connections or default_max_connections()

        # Connections, from the first packet on: silent, unserved, in a handshake, visits, websockets
        self._state = ServerState()
        self._visits: OrderedDict[Any, _Visit] = OrderedDict()
        """Connections that are no websockets, in order of arrival."""
        self._arriving: OrderedDict[asyncio.Task[None], str] = OrderedDict()
        """Addresses of clients whose handshake is in progress, in order of arrival."""
        self._silent: OrderedDict[socket.socket, tuple[str, float]] = OrderedDict()
        """Accepted and silent so far, with address and time of arrival, s. They cost little."""
        self._unserved: set[socket.socket] = set()
        """They have sent something, but have no protocol yet."""
        self._lingering: set[Any] = set()
        self._tasks: list[asyncio.Task[None]] = []
        """Tasks of the listener itself, once it has started."""

    def connections(self) -> int:
        """Return the number of connections, websockets included."""
        return len(self._state.connections) + len(self._silent)

    async def start(self) -> None:
        """Start to accept connections."""
        self._tasks = [
            asyncio.create_task(self._accept(), name=f"port {self.port} accepts"),
            asyncio.create_task(self._cut_periodically(), name=f"port {self.port} cuts idle connections"),
        ]

    async def _cut_periodically(self) -> None:
        while True:
            await asyncio.sleep(CUT_PERIOD_S)
            self.cut_lingering()

    def cut_lingering(self) -> None:
        """Cut idle connections. Called once a second.

        Those were to be closed by the last call and do not read, or were quiet for `QUIET_S`.
        """
        now_s = asyncio.get_running_loop().time()
        for client, (_, since_s) in list(self._silent.items()):
            if now_s - since_s > QUIET_S:
                self._hang_up(client)

        # They had a second to close by themselves
        closing = {connection for connection in self._state.connections if connection.transport.is_closing()}
        for connection in closing & self._lingering:
            _cut_connection(connection)
        self._lingering = closing

        # A connection is alive if it has a new request, works on one, or its client has read something
        for connection, visit in list(self._visits.items()):
            if connection not in self._state.connections:
                del self._visits[connection]
                continue
            cycle = connection.cycle
            owed = connection.transport.get_write_buffer_size()
            has_changed = cycle is not visit.cycle or owed != visit.owed
            if has_changed or (not owed and _is_busy(connection)):
                visit.cycle = cycle
                visit.owed = owed
                visit.since_s = now_s
            elif now_s - visit.since_s > QUIET_S:
                _cut_connection(connection)

    async def close(self) -> None:
        """Stop accepting, and close or cut every connection."""
        tasks = [*self._tasks, *self._arriving]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for client in [*self._silent, *self._unserved]:
            self._hang_up(client)
        self._socket.close()

        # Responses in progress may end, for a while
        state = self._state
        for connection in list(state.connections):
            connection.shutdown()
        if state.tasks:
            await asyncio.wait(set(state.tasks), timeout=CLOSE_S)

        # What is left is cut
        for connection in list(state.connections):
            _cut_connection(connection)
        for task in state.tasks:
            task.cancel()
        if state.tasks:
            await asyncio.wait(set(state.tasks), timeout=CLOSE_S)
        await asyncio.sleep(0)  # protocols learn of cut connections in the next round of the loop

    async def _accept(self) -> None:
        loop = asyncio.get_running_loop()
        for count in itertools.count(1):
            try:
                accepted, peer = await loop.sock_accept(self._socket)
            except ConnectionError:
                continue  # gone again already
            except OSError as error:
                log.warning("port %d accepts no connections for now: %s", self.port, system_reason(error))
                await asyncio.sleep(REST_S)
                continue

            # A protocol costs memory: it is made when the client has sent something
            address = peer[0]
            if sys.platform == "win32":  # its loop waits for no socket to be readable
                self._on_first_bytes(accepted, address)
            else:
                self._silent[accepted] = (address, loop.time())
                loop.add_reader(accepted, self._on_first_bytes, accepted, address)
            if len(self._silent) > min(MAX_ARRIVING, self._max_connections):
                addresses = {client: address for client, (address, _) in self._silent.items()}
                self._hang_up(_of_busiest(addresses)[0])

            # sock_accept does not give way while clients wait
            if count % AT_ONCE == 0:
                await asyncio.sleep(0)

    def _hang_up(self, client: socket.socket) -> None:
        if self._silent.pop(client, None) is not None:
            asyncio.get_running_loop().remove_reader(client)
        self._unserved.discard(client)
        client.close()

    def _on_first_bytes(self, accepted: socket.socket, address: str) -> None:
        if self._silent.pop(accepted, None) is not None:
            asyncio.get_running_loop().remove_reader(accepted)
        if len(self._arriving) >= MAX_ARRIVING:
            oldest = _of_busiest(self._arriving)[0]
            del self._arriving[oldest]
            oldest.cancel()
        self._unserved.add(accepted)
        task = asyncio.create_task(self._let_in(accepted, address), name=f"port {self.port} lets in")
        self._arriving[task] = address
        task.add_done_callback(functools.partial(self._on_arrived, accepted))

    def _on_arrived(self, accepted: socket.socket, task: asyncio.Task[None]) -> None:
        self._arriving.pop(task, None)
        if accepted in self._unserved:  # cancelled before it began
            self._hang_up(accepted)

    async def _let_in(self, accepted: socket.socket, address: str) -> None:
        self._unserved.discard(accepted)
        loop = asyncio.get_running_loop()

        # asyncio accepts timeouts only with TLS
        handshake_timeout_s = None if self._tls is None else ARRIVING_S
        shutdown_timeout_s = None if self._tls is None else CLOSE_S
        with contextlib.suppress(OSError):  # gone, without TLS or too slow: the connection is closed
            _, connection = await loop.connect_accepted_socket(
                self._make_connection,
                accepted,
                ssl=self._tls,
                ssl_handshake_timeout=handshake_timeout_s,
                ssl_shutdown_timeout=shutdown_timeout_s,
            )
            self._visits[connection] = _Visit(address=address, since_s=loop.time())
            if len(self._state.connections) > self._max_connections:
                self._make_room(connection)

    def _make_room(self, newest: Any) -> None:
        """Cut connections of the address that has most: those idle for longest, else that stuck for longest.

        Several at a time, since to look for them takes time. `newest` is cut if all others are websockets.
        """
        addresses: dict[Any, str] = {}
        for connection, visit in self._visits.items():
            if connection is newest or connection not in self._state.connections:
                continue
            if not connection.transport.is_closing():
                addresses[connection] = visit.address

        # Of the address with most, the idle ones first, each group from the oldest on
        def cut_order(connection: Any) -> tuple[bool, float]:
            return (_is_busy(connection), self._visits[connection].since_s)

        crowd = sorted(_of_busiest(addresses), key=cut_order)
        oldest = crowd[: self._max_connections // 16]
        idle = [connection for connection in oldest if not _is_busy(connection)]
        for connection in idle or crowd[:1] or [newest]:
            del self._visits[connection]
            _cut_connection(connection)

    def _make_connection(self) -> asyncio.Protocol:
        return H11Protocol(self._config, self._state, {})


def _cut_connection(connection: Any) -> None:
    """Close it at once; TLS that was closed twice, for which 3.11.2 raises, by `ssl_shutdown_timeout`."""
    with contextlib.suppress(AttributeError):
        connection.transport.abort()


def _of_busiest(addresses: Mapping[Any, str]) -> list[Any]:
    """Return the clients of the address that has most, in their order."""
    counts = Counter(addresses.values()).most_common(1)
    if not counts:
        return []
    busiest, _ = counts[0]
    return [client for client, address in addresses.items() if address == busiest]


def _is_busy(connection: Any) -> bool:
    cycle = connection.cycle
    return cycle is not None and not cycle.response_complete
