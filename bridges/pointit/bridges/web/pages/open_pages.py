"""All open pages: wakes them on changes, sends the status, measures their latency."""

import asyncio
import contextlib
import math
from collections import deque
from collections.abc import Callable, Generator

from starlette.responses import PlainTextResponse
from starlette.websockets import WebSocket

from pointit.bridges.web.pages.latest_values import LatestValueCache
from pointit.bridges.web.pages.page_requests import hello_of
from pointit.bridges.web.pages.page_session import Host, PageSession
from pointit.bridges.web.wire import IN_FLIGHT, Ack, Role, Status
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import Timer

GATHER_S = 0.004
"""Time (s) to gather related messages, so that a movement of the hand is one batch, not four."""

STATUS_S = 0.05
"""Time (s) to gather changes of the status."""

SLOW_MS = 500.0
"""Pages whose latency exceeds this cause a warning."""

LATENCIES_S = 5.0
"""Window of the quantile."""

MAX_LATENCIES = 4096


class Pages:
    """The sessions of one server."""

    def __init__(
        self,
        cache: LatestValueCache,
        bus: ServiceBus,
        status: Callable[[str], Status],
        *,
        rate_hz: float,
        max_viewers: int,
        version: str,
        speaks: bool,
    ) -> None:
        self._speaks = speaks
        self._cache = cache
        self._bus = bus
        self._status = status
        self._rate_hz = rate_hz
        self._max_viewers = max_viewers
        self._version = version
        self._sessions: set[PageSession] = set()
        self._count = 0
        self._past_pages = 0
        """Number of pages that look at the past."""
        self._flush_timer = Timer(bus.call_later, self._flush)
        self._status_timer = Timer(bus.call_later, self.tell_status)
        self._latencies = Latencies()
        self._before = (0, 0, 0)
        """Batches, bytes and dropped events of pages that have left."""
        self._reported = (0, 0)
        self._reported_s = asyncio.get_running_loop().time()
        bus.set_metric("viewers", 0.0)

    def __len__(self) -> int:
        return len(self._sessions) + self._past_pages

    async def open(
        self,
        socket: WebSocket,
        role: Role,
        host: Host,
        closed: Callable[[str], None],
        paired_user: Callable[[], str] = str,
    ) -> None:
        """Serve a page until it ends; then call `closed` with its name."""
        if self.is_full:
            await self.refuse(socket)
            return
        self._count += 1
        feed = self._cache.open(self._rate_hz)
        session = PageSession(f"page{self._count}", role, socket, feed, host)
        session.paired_user = paired_user
        self._sessions.add(session)
        self._count_viewers()
        try:
            hello = hello_of(
                role, version=self._version, site=self._bus.site, speaks=self._speaks, user=paired_user()
            )
            await session.run(hello.model_dump_json())
        finally:
            self._sessions.discard(session)
            self._cache.close(session.feed)
            batches, sent_bytes, dropped = self._before
            self._before = (
                batches + session.counts.batches,
                sent_bytes + session.counts.bytes,
                dropped + session.feed.dropped,
            )
            closed(session.page)
            self._count_viewers()

    @contextlib.contextmanager
    def count_past_page(self) -> Generator[None]:
        """Count a page that looks at the past, and is not served here."""
        self._past_pages += 1
        self._count_viewers()
        try:
            yield
        finally:
            self._past_pages -= 1
            self._count_viewers()

    @property
    def is_full(self) -> bool:
        """Return True if no further page may be opened."""
        return len(self) >= self._max_viewers

    async def refuse(self, socket: WebSocket) -> None:
        """Refuse a page, as there are too many."""
        response = PlainTextResponse(
            f"{self._max_viewers} pages are open, which is the most (most_viewers)", 503
        )
        await socket.send_denial_response(response)

    def notify_pages(self, *, now: bool = False) -> None:
        """Send pages what is new, after a few ms for related messages, or at once if `now`."""
        if not self._sessions:
            return
        if now:
            self._flush()
        else:
            self._flush_timer.start(GATHER_S)

    def status_changed(self) -> None:
        """Send the status soon, together with other changes."""
        self._status_timer.start(STATUS_S)

    def tell_status(self) -> None:
        """Send every page the status."""
        self._status_timer.cancel()
        for session in self._sessions:
            status = self._status(session.page)
            if session.role != "operator":  # nobody else needs addresses
                status = status.model_copy(update={"devices": ()})
            session.tell_status(status.model_dump_json())

    def shown(self, ack: Ack) -> None:
        """Process a page's acknowledgement of a batch."""
        if ack.latency_ms is not None:
            self._latencies.add(ack.latency_ms, asyncio.get_running_loop().time())

    def measure(self) -> None:
        """Update metrics and warnings; once a second."""
        now_s = asyncio.get_running_loop().time()
        batches, sent_bytes, dropped = self._before
        for session in self._sessions:
            batches += session.counts.batches
            sent_bytes += session.counts.bytes
            dropped += session.feed.dropped
        span_s = max(now_s - self._reported_s, 1e-3)
        p95_ms = self._latencies.p95_ms(now_s)
        waiting = sum(session.feed.in_flight >= IN_FLIGHT for session in self._sessions)
        self._bus.set_metric("capture to page p95", p95_ms, "ms")
        self._bus.set_metric("batches", (batches - self._reported[0]) / span_s, "1/s")
        self._bus.set_metric("to pages", (sent_bytes - self._reported[1]) / span_s / 1e3, "kB/s")
        self._bus.set_metric("pages that wait", float(waiting))
        self._bus.set_metric("events dropped", float(dropped))
        self._reported, self._reported_s = (batches, sent_bytes), now_s
        if p95_ms is not None and p95_ms > SLOW_MS:
            self._bus.warn(
                "lag",
                f"pages show what was {p95_ms:.0f} ms ago (95th percentile): this machine or theirs is busy, "
                "or the network slow; the plan is lighter than the scene for a machine without graphics",
            )
        else:
            self._bus.clear("lag")

    def _count_viewers(self) -> None:
        self._bus.set_metric("viewers", float(len(self)))
        self.status_changed()

    def _flush(self) -> None:
        self._flush_timer.cancel()
        for session in self._sessions:
            session.wake()


class Latencies:
    """Latencies that pages report, from the capture at a wrist to the frame that shows it."""

    def __init__(self) -> None:
        self._reports: deque[tuple[float, float]] = deque(maxlen=MAX_LATENCIES)

    def add(self, latency_ms: float, now_s: float) -> None:
        """Add one."""
        self._reports.append((now_s, latency_ms))

    def p95_ms(self, now_s: float) -> float | None:
        """Return the 95th percentile (nearest rank) of the window, or None without reports."""
        while self._reports and now_s - self._reports[0][0] > LATENCIES_S:
            self._reports.popleft()
        values = sorted(latency_ms for _, latency_ms in self._reports)
        return values[math.ceil(0.95 * len(values)) - 1] if values else None
