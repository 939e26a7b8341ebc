"""Connections of a session to other sessions, and detection of a lost or refusing router."""

import asyncio
import contextlib
import logging
from collections import Counter
from collections.abc import Callable, Sequence

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.link.link import LEASE_MS, ROUTER_LOST, Link, ports_of
from pointit.runtime.zenoh.queries import ReplyLimit, query_replies
from pointit.runtime.zenoh.session import (
    close_session,
    configuration,
    open_cancellable,
    refusals,
    set_tcp_timeouts,
)
from pointit.schemas.table_types import NAME
from pointit.schemas.topics import ANY, SERVICE_ALIVE

log = logging.getLogger(__name__)

ASK_S = 1.0
MAX_TOKENS = 4096
"""Maximum number of services whose sites are read."""
MAX_SITES = 20
"""Maximum number of site names in an error message."""

SUSPICION_S = 2.0
"""Delay before a lost router is first tested for a refusal of our credentials, s. A restart takes less."""
MAX_SUSPICION_S = 30.0
"""Maximum time between two tests, s. It doubles after each test."""


async def sites_at(link: Link) -> tuple[str, ...]:
    """Return the names of all sites that have services at the addresses of `link`.

    The tuple is empty if no session answers, or if the router's rules hide other sites.
    """
    config = configuration(link)
    config.insert_json5("namespace", "null")
    try:
        session = await open_cancellable(config)
    except zenoh.ZError:
        return ()
    try:
        selector = f"pointit/*/{SERVICE_ALIVE.at(ANY)}"
        limit = ReplyLimit(MAX_TOKENS, max_of_key=1)
        replies = await query_replies(session.liveliness(), selector, limit=limit, timeout=ASK_S)
    finally:
        await close_session(session)
    names = set[str]()
    for reply in replies:
        if reply.ok is not None:
            names.add(str(reply.ok.key_expr).split("/")[1])
    return tuple(sorted(filter(NAME.match, names)))[:MAX_SITES]  # any session can have written these keys


class Connections:
    """Follows connections as they come and go, and sets their timeouts."""

    def __init__(
        self,
        session: zenoh.Session,
        endpoints: Sequence[str],
        on_change: Callable[[], None],
        *,
        one: bool = False,
    ) -> None:
        """Call `on_change` in the loop for each present connection of `session`, and after each change.

        `endpoints`: addresses to connect to or to listen at. `one`: new connections replace old ones.
        """
        self.routers: dict[str, bool] = {}
        """True for a router, False for another session, by the id of each connected session."""
        self._ups: Counter[str] = Counter()  # connects minus disconnects: they are reported in any order
        self._one = one
        self._on_change = on_change
        self._ports = ports_of(endpoints)
        self._is_open = True
        self._loop = asyncio.get_running_loop()
        self._listener = session.info.declare_transport_events_listener(
            Callback(self._on_event, indirect=False), history=True
        )

    def __bool__(self) -> bool:
        return bool(self.routers)

    def close(self) -> None:
        """Stop following connections."""
        if self._is_open:
            self._is_open = False
            self._listener.undeclare()

    def _on_event(self, event: zenoh.TransportEvent) -> None:  # on Zenoh's thread
        is_router = event.transport.whatami == zenoh.WhatAmI.ROUTER
        up = event.kind == zenoh.SampleKind.PUT
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._count_connection, str(event.transport.zid), is_router, up)

    def _count_connection(self, zid: str, is_router: bool, up: bool) -> None:
        if not self._is_open:
            return
        if up:
            set_tcp_timeouts(self._ports, LEASE_MS)
            if self._one and self.routers:
                self.routers.clear()
                self._on_change()
        self._ups[zid] += 1 if up else -1
        if self._ups[zid] > 0:
            self.routers[zid] = is_router
        else:
            self.routers.pop(zid, None)
        if not self._ups[zid]:
            del self._ups[zid]
        self._on_change()


class LinkWatch:
    """Tracks whether a client has its router. Logs a loss and a return once each."""

    def __init__(self, session: zenoh.Session, link: Link, on_back: Callable[[], None]) -> None:
        """Watch the connected `session`. Call `on_back` after each reconnection."""
        self._link = link
        self._on_back = on_back
        self._refusal = ""
        self._suspicion_timer: asyncio.Task[None] | None = None
        self._loop = asyncio.get_running_loop()
        self.where = " or ".join(link.connect)
        self._lost_s: float | None = None
        self._connections = Connections(session, link.connect, self._on_change, one=True)

    @property
    def up(self) -> bool:
        """Return True if there is a router."""
        return self._lost_s is None

    @property
    def problem(self) -> str:
        """Return one sentence while the router is lost."""
        if self._lost_s is None:
            return ""
        ago_s = self._loop.time() - self._lost_s
        loss = ROUTER_LOST.format(where=self.where, ago_s=ago_s)
        return f"{loss}: {self._refusal}" if self._refusal else loss

    def close(self) -> None:
        """Stop watching and logging."""
        self._connections.close()
        self._end_suspicion()

    def _on_change(self) -> None:
        if bool(self._connections) == self.up:
            return
        if self._connections:
            self._lost_s = None
            self._end_suspicion()
            log.info("router at %s is back", self.where)
            self._on_back()
        else:
            self._lost_s = self._loop.time()
            log.warning("router at %s is lost; trying again until it is back", self.where)
            if self._link.credentials is not None:
                self._suspicion_timer = self._loop.create_task(self._detect_refusal(), name="refusal")

    async def _detect_refusal(self) -> None:
        """Test whether the router is running but refuses our credentials, e.g. an expired certificate."""
        wait_s = SUSPICION_S
        while True:
            await asyncio.sleep(wait_s)
            wait_s = min(2.0 * wait_s, MAX_SUSPICION_S)
            previous = self._refusal
            self._refusal = await in_daemon_thread(lambda: refusals(self._link), "refusal")
            if self._refusal and self._refusal != previous:
                log.warning("%s", self._refusal)

    def _end_suspicion(self) -> None:
        self._refusal = ""
        if self._suspicion_timer is not None:
            self._suspicion_timer.cancel()
            self._suspicion_timer = None
