"""Guard of a router: who floods is cut off, and what was denied is told. The only place that decides on it.

Every `LOOK_S` the operations in the router's log (`zenoh_trace`), and the bytes and segments that it does not
explain (`connection_traffic`), become the load of each identity (`connection_limits`, `identity_load`). Who
exceeds it is cut off. Every `TELL_S` denied operations, excess and its end are logged and published in the
router's health.
"""

import asyncio
import contextlib
import importlib.metadata
import logging
import re
from collections import Counter
from collections.abc import AsyncGenerator, Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Protocol

from pointit.access.connection_limits import (
    MAX_CONNECTIONS,
    ConnectionLimits,
    LimitedConnection,
    account_of,
    full_message,
    identity_of_account,
    loads_of,
)
from pointit.access.connection_traffic import ConnectionCounters, ConnectionTraffic
from pointit.access.denied_operations import DeniedOperations, RecentDenials
from pointit.access.identity_load import QUIET_S, Load
from pointit.access.zenoh_trace import FILTER, MARKS, ZenohTrace, is_configuration, version_warning
from pointit.schemas.problems import DENIED, EXCESS, REVOKED, Problem

log = logging.getLogger(__name__)

LOOK_S = 0.1
"""Interval at which the load of identities is compared with its limit, s."""
TELL_S = 1.0
"""Interval at which denied operations are reported, s."""
NO_COUNTERS = (
    "this system does not count what each connection sends: floods of messages on which access rules do not "
    "decide, and of bytes, are not seen; run the router on Linux"
)
NUMBER = re.compile(r"\d+")

CaptureLog = Callable[..., AbstractContextManager[None]]
"""`runtime.router_log.captured_log`."""


class CountersOfSocket(Protocol):
    """Counters of one connection, `runtime.socket_counters.SocketCounters`."""

    @property
    def received_bytes(self) -> int:
        """Bytes received since it opened."""
        ...

    @property
    def received_segments(self) -> int:
        """Number of segments with data."""
        ...

    @property
    def is_peer_full(self) -> bool:
        """True if the client reads nothing of what waits for it."""
        ...


class GuardedRouter(Protocol):
    """Interface of a router for its guard. `runtime.router.Router` has it, but its import loads Zenoh."""

    is_held: Callable[[str], bool]
    roles: dict[str, str]
    former: frozenset[str]
    times_opened: int
    has_counters: bool

    async def open(self) -> None:
        """Route."""

    async def close(self) -> None:
        """Stop routing."""

    async def reload_on_change(self) -> None:
        """Route until cancelled, and reopen after a change of a file."""

    def links(self) -> list[tuple[str, str, str]]:
        """Return session, common name and address of all who are connected."""
        ...

    def counters(self) -> Mapping[str, CountersOfSocket]:
        """Return the system's counters of connections, by the addresses that `links` returns."""
        ...

    def pop_new_connections(self) -> Counter[str]:
        """Return and reset the number of new connections by common name."""
        ...

    def cut(self, addresses: Iterable[str]) -> None:
        """End the connections from `addresses`."""

    def hold(self, addresses: Iterable[str]) -> None:
        """Discard what comes by the connections from `addresses` until they end."""

    def report(
        self, of_site: Callable[[str], Sequence[Problem]], refused: int, sessions: Mapping[str, int]
    ) -> None:
        """Publish warnings, refused attempts and connections to each site."""


class RouterGuard:
    """Guards one router."""

    def __init__(self, router: GuardedRouter, max_connections: int = MAX_CONNECTIONS) -> None:
        """Prepare. `max_connections`: maximum number of connections of one identity."""
        self._router = router
        self._limits = ConnectionLimits(max_connections)
        self._trace = ZenohTrace(self._on_identity)
        self._denied = DeniedOperations()
        self._recent = RecentDenials()
        self._traffic = ConnectionTraffic()
        self._full: dict[str, str] = {}
        """Messages on clients that do not read, by identity, until they are reported."""
        self._logged = LoggedOnce()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._times_opened = 1

    @contextlib.asynccontextmanager
    async def opened(self, capture_log: CaptureLog) -> AsyncGenerator[None]:
        """Open the router, whose log `capture_log` passes on, and close it at the end.

        Raises:
            ConfigError: The configuration cannot be used.
            ListenError: An address is taken or not ours.
        """
        warning = version_warning(importlib.metadata.version("eclipse-zenoh"))
        if warning:
            log.warning("%s", warning)
        if not self._router.has_counters:
            log.warning("%s", NO_COUNTERS)
        self._loop = asyncio.get_running_loop()
        self._router.is_held = self._is_held
        with capture_log(FILTER, self._trace.take, MARKS, is_configuration):
            await self._router.open()
            try:
                yield
            finally:
                await self._router.close()

    async def run(self) -> None:
        """Guard the open router until cancelled, and reopen it when its files change."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._guard(), name="floods")
            group.create_task(self._router.reload_on_change(), name="router")

    async def _guard(self) -> None:
        loop = asyncio.get_running_loop()
        reported_s = loop.time()
        while True:
            await asyncio.sleep(LOOK_S)
            now_s = loop.time()
            has_cut = self._limit_loads(now_s)
            elapsed_s = now_s - reported_s
            if has_cut or elapsed_s >= TELL_S:
                self._report(now_s, elapsed_s)
                reported_s = now_s

    def _limit_loads(self, now_s: float) -> bool:
        """Count what was done since the last look. Cut off who exceeds the limit, and return True if any."""
        # After the router has opened again all clients connect at once, which is no attack
        if self._router.times_opened != self._times_opened:
            self._times_opened = self._router.times_opened
            self._limits.allow_starts()
        counts = self._trace.pop()
        self._denied.add(counts)
        new_connections = self._router.pop_new_connections()
        loads = loads_of(counts, new_connections, self._router.former)
        self._add_traffic(loads, now_s)
        accounts = self._limits.step(loads, self._roles(), now_s)
        if accounts:
            own = [connection for connection in self._connections() if connection.account in accounts]
            self._router.cut(_addresses_to_cut(own))
        return bool(accounts)

    def _add_traffic(self, loads: dict[str, Load], now_s: float) -> None:
        """Add what the log does not have to `loads`. End the connections of clients that do not read."""
        counters = self._router.counters()
        counted: list[ConnectionCounters] = []
        for connection in self._connections():
            counts = counters.get(connection.address)
            if counts is None or not connection.account:
                continue
            counted.append(
                ConnectionCounters(
                    account=connection.account,
                    address=connection.address,
                    received_bytes=counts.received_bytes,
                    received_segments=counts.received_segments,
                    is_peer_full=counts.is_peer_full,
                )
            )
        logged: dict[str, float] = {}
        for account, load in loads.items():
            logged[account] = load.messages + load.requests + load.internal_requests
        result = self._traffic.step(counted, logged, self._router.former, now_s)
        for account, messages in result.unexplained.items():
            loads.setdefault(account, Load()).messages += messages
        if result.full:
            self._router.cut(result.full)
            accounts = {each.account for each in counted if each.address in result.full}
            self._full |= {identity_of_account(account): full_message(account) for account in accounts}

    def _report(self, now_s: float, elapsed_s: float) -> None:
        """Report what was denied and who is cut off, in the log and to doctor.

        Connections beyond the limit of an identity are closed.
        """
        sentences = self._denied.take_sentences(elapsed_s, self._router.former)

        # The trace forgets ended connections only after their names were used above
        connections = self._connections()
        names = {session: name for session, name, _ in self._router.links()}
        self._trace.keep(names)
        excess, exceeding = self._limits.excess(connections, self._roles())
        self._router.cut(connection.address for connection in excess)
        self._hold_connections(connections)

        # Health repeats a message for a while, the log has it once
        exceeding = {**self._full, **exceeding}
        self._full = {}
        messages = {DENIED: sentences, REVOKED: self._denied.revoked, EXCESS: exceeding}
        for kind, of_kind in messages.items():
            self._recent.add(of_kind, now_s, kind)
        for sentence in self._logged.new_sentences(messages, now_s):
            log.warning("%s", sentence)
        for sentence in self._limits.pop_ended_attacks().values():
            log.warning("%s", sentence)
        accounts = [connection.account for connection in connections]
        sessions = Counter(account.partition("/")[0] for account in accounts)
        self._router.report(self._problems_of, self._denied.total, sessions)

    def _problems_of(self, site: str) -> list[Problem]:
        """Return what doctor shows of `site`."""
        problems = list(self._recent.of(site))
        if not self._router.has_counters:
            problems.append(Problem(code="uncounted", sentence=NO_COUNTERS, severity="note"))
        return problems

    def _on_identity(self) -> None:
        """Hold a connection as soon as the log has its identity, as on a site with passwords."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop is gone
                self._loop.call_soon_threadsafe(self._hold_known)

    def _hold_known(self) -> None:
        if self._limits.has_held:
            self._hold_connections(self._connections())

    def _hold_connections(self, connections: Iterable[LimitedConnection]) -> None:
        """Hold the connections of identities that are cut off: those that opened after that."""
        held = [connection for connection in connections if self._limits.is_held(connection.account)]
        self._router.hold(_addresses_to_cut(held))

    def _is_held(self, common_name: str) -> bool:
        return self._limits.is_held(account_of(common_name, self._router.former))

    def _connections(self) -> list[LimitedConnection]:
        connections: list[LimitedConnection] = []
        for session, common_name, address in self._router.links():
            name = common_name or self._trace.common_name(session)
            account = account_of(name, self._router.former)
            connections.append(LimitedConnection(account=account, session=session, address=address))
        return connections

    def _roles(self) -> dict[str, str]:
        """Return the role of each account. Former common names have limits as people have."""
        return {**dict.fromkeys(self._router.former, "user"), **self._router.roles}


class LoggedOnce:
    """Picks sentences that are new. What lasts or comes back soon is logged once, whatever its numbers."""

    def __init__(self) -> None:
        self._logged_s: dict[tuple[str, str, str], float] = {}
        """Time at which a sentence was last true, s, by kind, identity and the sentence without numbers."""

    def new_sentences(self, messages: Mapping[str, Mapping[str, str]], now_s: float) -> list[str]:
        """Return the sentences that were not true lately. `messages` are by kind and identity."""
        for key, logged_s in list(self._logged_s.items()):
            if now_s - logged_s > QUIET_S:
                del self._logged_s[key]
        new: list[str] = []
        for kind, of_kind in messages.items():
            for identity, sentence in of_kind.items():
                key = (kind, identity, NUMBER.sub("#", sentence))
                if key not in self._logged_s:
                    new.append(sentence)
                self._logged_s[key] = now_s
        return new


def _addresses_to_cut(connections: Iterable[LimitedConnection]) -> Iterator[str]:
    for connection in connections:
        if connection.can_be_cut:
            yield connection.address
