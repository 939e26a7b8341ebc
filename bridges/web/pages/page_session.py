"""All open pages, and the websocket of each: woken on changes, sent the status, read within limits.

No core: it waits for websockets.
"""

import asyncio
import contextlib
import logging
import math
from collections import deque
from collections.abc import Callable, Collection, Generator
from dataclasses import dataclass
from typing import Protocol

from pydantic import TypeAdapter, ValidationError
from starlette.responses import PlainTextResponse
from starlette.websockets import WebSocket, WebSocketDisconnect

from pointit.bridges.web.pages.latest_values import LatestValueCache, PageFeed, TokenBucket
from pointit.bridges.web.wire import (
    IN_FLIGHT,
    Ack,
    AimAt,
    Answer,
    Ask,
    HeadsetMotion,
    Hello,
    PersonLine,
    Play,
    Received,
    Role,
    Status,
    Turn,
)
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import Timer
from pointit.schemas import summarize_validation_error

log = logging.getLogger(__name__)

MESSAGES_HZ = 500.0
"""Rate limit of a page's messages; beyond it they are read more slowly."""
MESSAGES_BURST = 1000.0
"""Number of messages beyond it at once."""

ASKS_HZ = 20.0
"""Rate limit of a page's requests; more are refused."""
ASKS_BURST = 40.0
"""Number of requests beyond it at once."""

VIEWERS_HZ = 50.0
"""Rate limit of what all pages that may only look send together, without valid acknowledgements."""
VIEWERS_BURST = 100.0
"""Number of those messages beyond it at once."""

VIEWERS_OPENED_HZ = 10.0
"""Rate limit of opening pages that may only look, as each begins with the whole state."""
VIEWERS_OPENED_BURST = 40.0
"""Number of those openings beyond it at once."""

MAX_TURN_S = 5.0
"""Maximum wait for that, s. A page that would wait longer is refused, and tries again later."""

AIMS_HZ = 120.0
"""Rate limit of aiming; of more, only the newest counts."""
AIMS_BURST = 20.0
"""Number of aims beyond it at once."""

MAX_PAST_PAGES = 8
"""Pages that look at the past, each of which holds and seeks a recording of its own."""

MAX_MALFORMED = 20
"""Malformed messages after which the page is closed."""

MAX_ANSWERS = 16
"""Requests handled at a time; then reading pauses until one is done."""

MALFORMED = 1008
"""Close code (RFC 6455): policy violation."""
NORMAL = 1000
"""Close code (RFC 6455): a normal end."""

_RECEIVED: TypeAdapter[Ack | Ask | AimAt | Play | Turn | HeadsetMotion] = TypeAdapter(Received)

GATHER_S = 0.004
"""Time (s) to gather related messages, so that a movement of the hand is one batch, not four."""

STATUS_S = 0.05
"""Time (s) to gather changes of the status."""

SLOW_MS = 500.0
"""Pages whose latency exceeds this cause a warning."""

LATENCIES_S = 5.0
"""Window of the quantile."""

MAX_LATENCIES = 4096


class Host(Protocol):
    """The service that owns the pages."""

    def header(self) -> tuple[int, float]:
        """Return the site's time, ns, and its speed."""
        ...

    async def answer(self, ask: Ask, session: "PageSession") -> Answer:
        """Handle a request."""
        ...

    def aim(self, aim: AimAt, session: "PageSession") -> None:
        """Point where the page's mouse does."""
        ...

    def move_by_headset(self, motion: HeadsetMotion, session: "PageSession") -> None:
        """Point as the wearer of the page's headset does."""
        ...

    def play(self, play: Play) -> None:
        """Control the page's playback."""
        ...

    def shown(self, ack: Ack) -> None:
        """Note that a page has shown a batch."""
        ...

    def malformed(self, sentence: str) -> None:
        """Note a malformed message."""
        ...


@dataclass(slots=True)
class Counts:
    """Numbers of what was sent to a page."""

    batches: int = 0
    bytes: int = 0


class PageSession:
    """One page, from its websocket's opening to its end."""

    def __init__(
        self,
        page: str,
        role: Role,
        socket: WebSocket,
        feed: PageFeed,
        host: Host,
        *,
        viewer_bucket: TokenBucket | None = None,
    ) -> None:
        self.page = page
        self.role: Role = role
        self.paired_user: Callable[[], str] = str
        """Returns the person whose phone's link this browser has opened, or `""`."""
        self.feed = feed
        self.counts = Counts()
        self._socket = socket
        self._host = host
        self._loop = asyncio.get_running_loop()

        # To be sent
        self._wake_event = asyncio.Event()
        self._wake_timer = Timer(self._loop.call_later, self._wake_event.set)
        self._texts: list[str] = []
        self._status = ""

        # Received, each kind within its rate
        self._slots = asyncio.Semaphore(MAX_ANSWERS)
        self._answering: set[asyncio.Task[None]] = set()
        self._message_bucket = TokenBucket(MESSAGES_HZ, MESSAGES_BURST)
        self._ask_bucket = TokenBucket(ASKS_HZ, ASKS_BURST)
        self._viewer_bucket = viewer_bucket if role == "viewer" else None
        self._aim_bucket = TokenBucket(AIMS_HZ, AIMS_BURST)
        self._aim: AimAt | None = None
        self._aim_timer = Timer(self._loop.call_later, self._forward_aim)
        self._malformed = 0
        self._is_shut = False
        """Closed by this side."""

    def wake(self) -> None:
        """Check for changes to send."""
        self._wake_event.set()

    def tell_status(self, status: str) -> None:
        """Send the status; replaces an unsent one."""
        self._status = status
        self._wake_event.set()

    def tell(self, text: str) -> None:
        """Send `text`, before what is newer on the bus."""
        self._texts.append(text)
        self._wake_event.set()

    async def run(self, hello: str) -> None:
        """Accept, send `hello` and serve until the page leaves or is closed."""
        await self._socket.accept()
        self._texts.insert(0, hello)
        sending = self._loop.create_task(self._send(), name=f"{self.page} sends")
        receiving = self._loop.create_task(self._receive(), name=f"{self.page} receives")
        try:
            await asyncio.wait({sending, receiving}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._wake_timer.cancel()
            self._aim_timer.cancel()
            tasks = {sending, receiving, *self._answering}
            for task in tasks:
                task.cancel()
            ends = await asyncio.gather(*tasks, return_exceptions=True)

        # A page may leave at any time: only other errors are faults
        for end in ends:
            if not isinstance(end, Exception) or isinstance(end, (WebSocketDisconnect, OSError)):
                continue
            if self._is_shut:
                continue  # the sending task was about to send
            raise end

    async def _send(self) -> None:
        """Send what is new at each wake: texts, the status, then a batch if the link has room."""
        socket = self._socket
        while True:
            # Cleared before anything is read: what comes during a send wakes again
            await self._wake_event.wait()
            self._wake_event.clear()
            while self._texts:
                texts = self._texts
                self._texts = []
                for text in texts:
                    await socket.send_text(text)
            if self._status:
                status = self._status
                self._status = ""
                await socket.send_text(status)
            batch = self.feed.take(self._loop.time())
            if batch is not None:
                packed = batch.packed(*self._host.header())
                self.counts.batches += 1
                self.counts.bytes += len(packed)
                await socket.send_bytes(packed)
            self._wake_later()

    def _wake_later(self) -> None:
        wait_s = self.feed.wait_s(self._loop.time())
        if wait_s is not None:
            self._wake_timer.start(wait_s)

    async def _receive(self) -> None:
        """Process messages within the page's allowance.

        While this waits, the next message pauses the transport, so that what the page sends further is not
        even parsed, see `PacedWebSocket`.
        """
        while True:
            # before receiving, since that resumes the transport
            wait_s = self._message_bucket.reserve(self._loop.time())
            if wait_s:
                await asyncio.sleep(wait_s)
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return

            # Acknowledgements are as many as batches are sent. Of viewers, all else and errors cost.
            parsed = self._parse_message(message.get("text"))
            is_free = isinstance(parsed, Ack) and self._on_ack(parsed)
            if self._viewer_bucket is not None and not is_free:
                await asyncio.sleep(self._viewer_bucket.reserve(self._loop.time()))
            if self._malformed >= MAX_MALFORMED:
                self._is_shut = True
                await self._socket.close(MALFORMED, "too many malformed messages")
                return

            # the request itself
            if isinstance(parsed, Ask):
                await self._begin_answer(parsed)
            elif isinstance(parsed, AimAt | Play | Turn | HeadsetMotion):
                self._on_motion(parsed)

    def _parse_message(self, text: str | None) -> Ack | Ask | AimAt | Play | Turn | HeadsetMotion | None:
        if text is None:
            self._on_malformed("page", "binary messages are not accepted")
            return None
        try:
            return _RECEIVED.validate_json(text)
        except ValidationError as error:
            self._on_malformed("page", summarize_validation_error(error))
        except (ValueError, RecursionError) as error:
            self._on_malformed("page", str(error))
        return None

    def _on_motion(self, message: AimAt | Play | Turn | HeadsetMotion) -> None:
        if isinstance(message, AimAt):
            self._on_aim(message)
        elif isinstance(message, Play):
            self._host.play(message)
        elif isinstance(message, Turn):
            self._on_malformed("Turn", "is for phones, at their own address")
        elif self._aim_bucket.take(self._loop.time()):  # the next one of a headset comes soon
            self._host.move_by_headset(message, self)

    def rights(self, user: str) -> Role:
        """Return the role with which this page may act for `user`."""
        is_own = self.role != "operator" and user != "" and self.paired_user() == user
        return "wrist" if is_own else self.role

    def _on_ack(self, ack: Ack) -> bool:
        """Process an acknowledgement. Return False if it is an error, which costs like a request."""
        if not self.feed.ack(ack.n):
            self._on_malformed("Ack", "of a batch that was never sent, or was acknowledged before")
            return False
        self._host.shown(ack)
        self._wake_event.set()
        return True

    def _on_malformed(self, what: str, sentence: str) -> None:
        self._malformed += 1
        self._host.malformed(f"{what}: {sentence}")

    def _on_aim(self, aim: AimAt) -> None:
        self._aim = aim
        if not self._aim_timer.is_running:
            self._forward_aim()

    def _forward_aim(self) -> None:
        aim = self._aim
        now_s = self._loop.time()
        if aim is None:
            return
        if self._aim_bucket.take(now_s):
            self._aim = None
            self._host.aim(aim, self)
        else:
            self._aim_timer.start(self._aim_bucket.wait_s(now_s))

    async def _begin_answer(self, ask: Ask) -> None:
        await self._slots.acquire()
        task = self._loop.create_task(self._answer(ask), name=f"{self.page} asks")
        self._answering.add(task)
        task.add_done_callback(self._on_answered)

    def _on_answered(self, task: asyncio.Task[None]) -> None:
        self._answering.discard(task)
        self._slots.release()

    async def _answer(self, ask: Ask) -> None:
        if self._ask_bucket.take(self._loop.time()):
            answer = await self._host.answer(ask, self)
        else:
            answer = Answer(id=ask.id, error="too many requests at a time: wait a moment")
        self.tell(answer.json_text())


class Pages:
    """The sessions of one server."""

    def __init__(
        self,
        cache: LatestValueCache,
        bus: ServiceBus,
        status: Callable[[], Status],
        users_of: Callable[[str], Collection[str]],
        *,
        rate_hz: float,
        max_viewers: int,
        hello: Callable[..., Hello],
    ) -> None:
        """Create them without pages.

        Args:
            cache: the newest messages.
            bus: of the page's service.
            status: returns the status of the site for a page that moves no wrist.
            users_of: returns the people whose wrists a page moves, by its name.
            rate_hz: maximum rate of batches to a page.
            max_viewers: maximum number of open pages.
            hello: returns the greeting for a role and a `user`.
        """
        self._hello = hello
        self._cache = cache
        self._bus = bus
        self._status = status
        self._users_of = users_of
        self._rate_hz = rate_hz
        self._max_viewers = max_viewers
        self._sessions: set[PageSession] = set()
        self._count = 0
        self.viewer_bucket = TokenBucket(VIEWERS_HZ, VIEWERS_BURST)
        """Budget of all pages that may only look, those of the past, too."""
        self._opening_bucket = TokenBucket(VIEWERS_OPENED_HZ, VIEWERS_OPENED_BURST)
        self._past_pages = 0
        """Number of pages that look at the past."""
        self._flush_timer = Timer(bus.call_later, self._flush)
        self._status_timer = Timer(bus.call_later, self.tell_status)
        # Figures of the health report
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
        name = f"page{self._count}"
        feed = self._cache.open(self._rate_hz)
        session = PageSession(name, role, socket, feed, host, viewer_bucket=self.viewer_bucket)
        session.paired_user = paired_user
        self._sessions.add(session)
        self._count_viewers()
        try:
            hello = self._hello(role, user=paired_user())
            await session.run(hello.model_dump_json())
        finally:
            # Its totals outlive it, so that rates do not fall when a page leaves
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

    async def admit(self, socket: WebSocket, role: Role) -> bool:
        """Wait for a page's turn to open. Return False if it was refused, as too many open at a time."""
        if role != "viewer":
            return True
        now_s = asyncio.get_running_loop().time()
        if self._opening_bucket.wait_s(now_s) > MAX_TURN_S:
            text = "too many pages open at a time: try again in some seconds"
            await socket.send_denial_response(PlainTextResponse(text, 503))
            return False
        await asyncio.sleep(self._opening_bucket.reserve(now_s))
        return True

    @property
    def is_full(self) -> bool:
        """Return True if no further page may be opened."""
        return len(self) >= self._max_viewers

    @property
    def is_past_full(self) -> bool:
        """Return True if no further page may look at the past."""
        return self._past_pages >= MAX_PAST_PAGES

    async def refuse(self, socket: WebSocket) -> None:
        """Refuse a page, as there are too many."""
        text = f"{self._max_viewers} pages are open, which is the most (most_viewers)"
        if not self.is_full:
            text = f"{MAX_PAST_PAGES} pages look at the past, which is the most: close one"
        response = PlainTextResponse(text, 503)
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
        """Send every page the status, diagnosed once, and serialized once for pages that move no wrist."""
        self._status_timer.cancel()
        if not self._sessions:
            return
        for_operators = self._status()
        for_others = for_operators.model_copy(update={"devices": ()})  # nobody else needs addresses
        operators_text = for_operators.model_dump_json()
        others_text = for_others.model_dump_json()
        for session in self._sessions:
            is_operator = session.role == "operator"
            users = self._users_of(session.page)
            if users:
                status = for_operators if is_operator else for_others
                own_status = with_own_people(status, users)
                session.tell_status(own_status.model_dump_json())
            elif is_operator:
                session.tell_status(operators_text)
            else:
                session.tell_status(others_text)

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
        # Rates since the report before
        reported_batches, reported_bytes = self._reported
        span_s = max(now_s - self._reported_s, 1e-3)
        p95_ms = self._latencies.p95_ms(now_s)
        waiting = sum(session.feed.in_flight >= IN_FLIGHT for session in self._sessions)
        self._bus.set_metric("capture to page p95", p95_ms, "ms")
        self._bus.set_metric("batches", (batches - reported_batches) / span_s, "1/s")
        self._bus.set_metric("to pages", (sent_bytes - reported_bytes) / span_s / 1e3, "kB/s")
        self._bus.set_metric("pages that wait", float(waiting))
        self._bus.set_metric("events dropped", float(dropped))
        self._reported = (batches, sent_bytes)
        self._reported_s = now_s

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


def with_own_people(status: Status, users: Collection[str]) -> Status:
    """Return `status` for the page that moves the wrists of `users`."""
    people: list[PersonLine] = []
    for line in status.people:
        people.append(line.model_copy(update={"is_mine": line.user in users}))
    return status.model_copy(update={"people": tuple(people)})


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
        if not values:
            return None
        rank = math.ceil(0.95 * len(values))
        return values[rank - 1]
