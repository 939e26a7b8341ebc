"""A session on a foreign Zenoh network: raw bytes and attachments, samples, queries, answers.

Samples arrive on Zenoh's threads, all else in the loop that opened the session. No call in the loop waits for
a reader elsewhere.
"""

import asyncio
import contextlib
import logging
import threading
from collections.abc import AsyncGenerator, Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import zenoh
from zenoh import ext
from zenoh.handlers import Callback

from pointit.runtime.bus.contract import Closable, Declaration
from pointit.runtime.bus.mailbox import Dispatcher
from pointit.runtime.errors import BusClosedError, BusError, ConfigError, ConnectError, ListenError
from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.link.link import ENDPOINT
from pointit.runtime.zenoh.connections import Connections
from pointit.runtime.zenoh.declarations import (
    declare_caching_subscriber,
    declare_publisher,
    declare_subscriber,
)
from pointit.runtime.zenoh.liveliness import LivelinessSubscriber
from pointit.runtime.zenoh.queries import declare_queryable, refuse
from pointit.runtime.zenoh.session import close_session, config_of, is_in_use
from pointit.runtime.zenoh.session import open_first as open_session

log = logging.getLogger(__name__)

Mode = Literal["peer", "client", "router"]

HEARTBEAT_S = 0.5
"""Period (s) after which a reader notices that it lost the last message of a reliable, caching writer."""
MAX_ATTACHMENT_BYTES = 4096
"""Messages with a longer attachment are dropped."""

MAX_OPEN = 64
"""Limit of queries that a queryable has accepted and not answered. Further ones are refused."""
QUERY_TIMEOUT_S = 600.0
"""Time for which Zenoh keeps a query alive. The querier has a deadline of its own, and cancels."""
MAX_REASON_CHARACTERS = 500
MAX_ANSWERS = 16
"""Limit of answers to one query that wait for the loop. Further ones are dropped."""
CONNECT_TIMEOUT_MS = 1000
"""Duration of one attempt at most. Closing a session waits for the current attempt."""
SCOUTING_DELAY_MS = 500
"""Time that a peer waits for other peers when it opens."""
QUERY_TIMEOUT_MS = 600_000
"""Lifetime of forwarded queries. Our own have deadlines of their own."""
SEND_BATCHES = 16
"""Batches of 64 KB that wait for a slower link before messages are dropped."""
MAX_MESSAGE_BYTES = 16 * 1024 * 1024
"""Size limit of reassembled messages, unless we route for others."""


def bytes_of(data: zenoh.ZBytes | None) -> bytes | None:
    """Return the content of a payload or attachment."""
    return None if data is None else data.to_bytes()


def is_oversized(payload: zenoh.ZBytes | None, attached_bytes: zenoh.ZBytes | None, max_bytes: int) -> bool:
    """Return True if a message exceeds the size limit. Its bytes are not copied."""
    if payload is not None and len(payload) > max_bytes:
        return True
    return attached_bytes is not None and len(attached_bytes) > MAX_ATTACHMENT_BYTES


class RawSample:
    """A received sample; its bytes are copied when they are read."""

    __slots__ = ("_sample",)

    def __init__(self, sample: zenoh.Sample) -> None:
        self._sample = sample

    @property
    def payload(self) -> bytes:
        """Return its bytes."""
        return self._sample.payload.to_bytes()

    @property
    def attachment(self) -> bytes | None:
        """Return the bytes of its attachment, or None if it has none."""
        return bytes_of(self._sample.attachment)

    def is_oversized(self, max_bytes: int) -> bool:
        """Return True if it exceeds the size limit."""
        return is_oversized(self._sample.payload, self._sample.attachment, max_bytes)


class RawPublisher(Declaration):
    """Writes one key."""

    def __init__(self, session: zenoh.Session, key: str, cache_size: int, reliable: bool) -> None:
        missed = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S) if reliable else None
        self._writer = declare_publisher(session, key, cache=cache_size, missed=missed)
        super().__init__(self._writer.undeclare)

    @property
    def is_read(self) -> bool:
        """Return True if Zenoh knows a reader in another session; a writer that keeps messages does not."""
        if self.is_closed or not isinstance(self._writer, zenoh.Publisher):
            return False
        status: Any = self._writer.matching_status  # no bool, whatever the stubs say: always true
        return bool(status.matching)

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        """Send; returns at once.

        Raises:
            BusClosedError: this writer or its session is closed.
        """
        try:
            self._writer.put(payload, attachment=attachment)
        except zenoh.ZError as error:
            raise BusClosedError("the writer or its session was closed") from error


class IncomingQuery:
    """A query that must be answered once, since otherwise the querier waits for a time-out."""

    def __init__(self, query: zenoh.Query, done: Callable[[], None]) -> None:
        self.payload = bytes_of(query.payload) or b""
        self.attachment = bytes_of(query.attachment)
        self._query: zenoh.Query | None = query
        self._done = done

    async def answer(self, payload: bytes, attachment: bytes | None) -> None:
        """Answer in a separate thread, since Zenoh waits for a busy link. Other queries are not delayed."""

        def reply(query: zenoh.Query) -> None:
            with query, contextlib.suppress(zenoh.ZError):  # the querier is gone, or our session is
                query.reply(str(query.key_expr), payload, attachment=attachment)

        await self._end(reply)

    async def refuse(self, reason: str) -> None:
        """Send an error reply."""
        await self._end(lambda query: refuse(query, reason[:MAX_REASON_CHARACTERS]))

    def drop(self) -> None:
        """Drop the query without an answer, because the queryable was closed."""
        query = self._pop_query()
        if query is not None:
            query.drop()

    async def _end(self, reply: Callable[[zenoh.Query], None]) -> None:
        query = self._pop_query()
        if query is not None:
            await in_daemon_thread(lambda: reply(query), "zenoh-reply")

    def _pop_query(self) -> zenoh.Query | None:
        query = self._query
        self._query = None
        if query is not None:
            self._done()
        return query


class RawQueryable(Declaration):
    """Accepts a limited number of queries at a time; see `RawSession.queryable`."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        dispatcher: Dispatcher,
        handler: Callable[[IncomingQuery], None],
        max_bytes: int,
    ) -> None:
        self._dispatcher = dispatcher
        self._handler = handler
        self._max_bytes = max_bytes
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._open = 0
        super().__init__(declare_queryable(session, key, self._on_query).undeclare)

    def _on_query(self, query: zenoh.Query) -> None:  # on Zenoh's threads
        if reason := self._objection(query):
            refuse(query, reason)
            return
        incoming_query = IncomingQuery(query, self._release)
        try:
            self._loop.call_soon_threadsafe(self._receive, incoming_query)
        except RuntimeError:  # the loop is gone
            incoming_query.drop()

    def _objection(self, query: zenoh.Query) -> str:
        if is_oversized(query.payload, query.attachment, self._max_bytes):
            return f"too long, at most {self._max_bytes} bytes are taken"
        with self._lock:
            if self._open >= MAX_OPEN:
                return f"busy, {MAX_OPEN} requests are waiting already"
            self._open += 1
        return ""

    def _release(self) -> None:
        with self._lock:
            self._open -= 1

    def _receive(self, query: IncomingQuery) -> None:
        if self.is_closed or self._dispatcher.is_closed:
            query.drop()
        else:
            self._handler(query)


@dataclass(frozen=True, slots=True)
class QueryReply:
    """One answer, or the reason for its absence."""

    payload: bytes
    attachment: bytes | None
    refusal: str = ""


class RawQuerier(Declaration):
    """Asks at one key."""

    def __init__(self, session: zenoh.Session, key: str, dispatcher: Dispatcher, max_bytes: int) -> None:
        self._dispatcher = dispatcher
        self._max_bytes = max_bytes
        self._loop = asyncio.get_running_loop()
        # Answers have the congestion control of their query. With DROP, a busy machine loses long answers,
        # and with them the end of all answers. A message that waits for a link delays only messages of its
        # own priority.
        self._querier = session.declare_querier(
            key,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=QUERY_TIMEOUT_S,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.DATA_LOW,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        super().__init__(self._querier.undeclare)

    async def wait_for_server(self) -> None:
        """Return when a queryable exists at this key."""
        if self._has_server():
            return
        is_matched = asyncio.Event()

        def on_matching(status: zenoh.MatchingStatus) -> None:  # on Zenoh's threads
            if status.matching:
                with contextlib.suppress(RuntimeError):  # the loop is gone
                    self._loop.call_soon_threadsafe(is_matched.set)

        listener = self._querier.declare_matching_listener(Callback(on_matching, indirect=False))
        try:
            # it may have come between the first look and the listener
            if not self._has_server():
                await is_matched.wait()
        finally:
            if not self._is_over():
                listener.undeclare()

    async def ask(self, payload: bytes, attachment: bytes | None) -> AsyncGenerator[QueryReply]:
        """Yield the answers as they arrive, until all queryables have answered. Closing cancels the query.

        The query is sent in a separate thread, since Zenoh waits for a busy link.
        """
        waiting: asyncio.Queue[QueryReply | None] = asyncio.Queue()
        token = zenoh.CancellationToken()

        def on_reply(reply: zenoh.Reply) -> None:  # on Zenoh's threads
            if waiting.qsize() < MAX_ANSWERS:
                post(self._read(reply))

        def post(answer: QueryReply | None) -> None:
            with contextlib.suppress(RuntimeError):  # the loop is gone
                self._loop.call_soon_threadsafe(waiting.put_nowait, answer)

        def send() -> None:
            callback = Callback(on_reply, lambda: post(None), indirect=False)
            self._querier.get(callback, payload=payload, attachment=attachment, cancellation_token=token)

        # A query that nobody awaits any more must not go on until all queryables have answered
        done = False
        try:
            await in_daemon_thread(send, "zenoh-ask")
            while (answer := await waiting.get()) is not None:
                yield answer
            done = True
        finally:
            if not done and not self._is_over():
                self._loop.run_in_executor(None, token.cancel)

    def _is_over(self) -> bool:
        return self.is_closed or self._dispatcher.is_closed

    def _has_server(self) -> bool:
        status: Any = self._querier.matching_status  # no bool, whatever the stubs say: always true
        return bool(status.matching)

    def _read(self, reply: zenoh.Reply) -> QueryReply:
        sample = reply.ok
        if sample is None:
            if reply.err is None:
                return QueryReply(b"", None, "refused")
            reason = reply.err.payload.to_bytes()[:MAX_REASON_CHARACTERS]
            return QueryReply(b"", None, reason.decode(errors="replace") or "refused")
        if is_oversized(sample.payload, sample.attachment, self._max_bytes):
            return QueryReply(b"", None, f"its answer is longer than {self._max_bytes} bytes")
        return QueryReply(sample.payload.to_bytes(), bytes_of(sample.attachment))


@dataclass(frozen=True, kw_only=True)
class RawLink:
    """Role in the network: a peer, a client, or the router that others connect to."""

    endpoint: str
    """Address to connect to, or of a router: to listen on."""
    mode: Mode = "peer"
    remedy: str = ""
    """Advice if nothing answers there, for people."""


def plain_configuration(link: RawLink) -> zenoh.Config:
    """Return Zenoh's configuration for `link`.

    Raises:
        ConfigError: the endpoint is not one.
    """
    if not ENDPOINT.fullmatch(link.endpoint):
        raise ConfigError(f"{link.endpoint!r} is no address; write one like tcp/127.0.0.1:7447")
    is_router = link.mode == "router"
    retry = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5}
    peer_strategy = {"to_router": "always", "to_peer": "greater-zid"}
    settings: dict[str, Any] = {
        "mode": link.mode,
        "connect/endpoints": [] if is_router else [link.endpoint],
        "connect/retry": retry,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        # Peers announce themselves only to the router. Of two peers one connects to the other.
        "scouting/gossip/target": {"router": ["router", "peer"], "peer": ["router"]},
        "scouting/gossip/autoconnect": {"router": [], "peer": ["router", "peer"]},
        "scouting/gossip/autoconnect_strategy": {"peer": peer_strategy},
        "timestamping/enabled": True,  # otherwise no messages are cached for late readers
        "queries_default_timeout": QUERY_TIMEOUT_MS,
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": CONNECT_TIMEOUT_MS,
        # a peer that does not read makes us drop, not wait
        "transport/link/tx/queue/congestion_control/drop": {
            "wait_before_drop": 0,
            "max_wait_before_drop_fragments": 0,
        },
        "transport/link/tx/queue/size/data": SEND_BATCHES,
    }
    if is_router:
        settings |= {"listen/endpoints": [link.endpoint], "scouting/delay": 0}
    else:
        settings["transport/link/rx/max_message_size"] = MAX_MESSAGE_BYTES
    if link.mode == "peer":
        settings |= {
            "listen/endpoints": ["tcp/127.0.0.1:0"],
            "connect/timeout_ms": -1,  # with the next line: opens at once, and goes on trying
            "connect/exit_on_failure": False,
            "scouting/delay": SCOUTING_DELAY_MS,
        }
    elif link.mode == "client":
        settings |= {"connect/timeout_ms": CONNECT_TIMEOUT_MS, "listen/endpoints": []}
    return config_of(settings)


async def open_raw_session(
    link: RawLink, *, patience_s: float | None = None, on_wait: Callable[[str], None] = log.warning
) -> "RawSession":
    """Return an open session; may be cancelled at any time.

    A peer opens within a second, with or without others. A client is retried for `patience_s`, or without
    end. In the latter case `on_wait` is called once, with a sentence.

    Raises:
        ConfigError: If the endpoint is invalid.
        ListenError: If the router's address is in use.
        ConnectError: If nothing answered the client within `patience_s`.
    """
    # Only a client needs an answer: a peer opens alone, and a router listens
    sentence = f"nobody answers at {link.endpoint}"
    if link.remedy:
        sentence += f": {link.remedy}"

    async def problem_of(error: zenoh.ZError) -> BusError:
        if link.mode == "client":
            return ConnectError(sentence)
        hint = "a router is running there already: join it as a peer, or " if is_in_use(error) else ""
        return ListenError(f"cannot listen on {link.endpoint}; {hint}choose another address")

    def report_wait() -> None:
        on_wait(f"{sentence}; trying again until somebody does")

    session = await open_session(
        [plain_configuration(link)],
        (link.endpoint,),
        problem_of,
        patience_s=patience_s,
        on_wait=report_wait,
    )
    return RawSession(session, link)


class RawSession:
    """Our declarations on that network. Closing it undeclares all."""

    def __init__(self, session: zenoh.Session, link: RawLink) -> None:
        """Use `session`, which is closed with this; `open_raw_session` is the usual way in."""
        self.zid = str(session.info.zid())
        self.dispatcher = Dispatcher()
        """Wakes the loop; closed with this session."""
        self.on_change: Callable[[], None] | None = None
        """Called when `problem` has changed."""
        self._session = session
        self._link = link
        self._connections = Connections(session, (link.endpoint,), self._on_connections)
        self._had_router = False
        self._was_left = False
        self._problem = self.problem

    @property
    def problem(self) -> str:
        """Return a message if a required connection is missing, else `""`."""
        link = self._link
        if link.mode == "router" or any(self._connections.routers.values()):
            return ""
        remedy = link.remedy and f": {link.remedy}"
        if self._had_router:
            return f"the router at {link.endpoint} is lost, trying again until it is back{remedy}"
        if self._connections:
            return (
                f"who answers at {link.endpoint} is no router and passes nothing on; if it is a "
                f"`pointit run`, let that --listen elsewhere{remedy}"
            )
        return f"no router answers at {link.endpoint}, trying again until one does{remedy}"

    def publisher(self, key: str, *, cache_size: int = 0, reliable: bool = True) -> RawPublisher:
        """Declare a writer of `key`, which keeps its last `cache_size` messages for late readers."""
        self._check_open()
        return RawPublisher(self._session, key, cache_size, reliable)

    def subscriber(
        self, key: str, handler: Callable[[RawSample], None], *, cache_size: int = 0, reliable: bool = True
    ) -> Closable:
        """Call `handler` on Zenoh's threads for samples of others on `key`, which may have wildcards.

        `cache_size`: number of a writer's last messages to fetch from caches. `reliable`: fetch those lost on
        the way, too.
        """
        self._check_open()

        def on_sample(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                handler(RawSample(sample))

        if not cache_size:
            return Declaration(declare_subscriber(self._session, key, on_sample).undeclare)
        declared = declare_caching_subscriber(
            self._session, key, on_sample, history=cache_size, recovers=reliable, is_announced=True
        )
        return Declaration(declared.undeclare)

    def token(self, key: str) -> Closable:
        """Declare the token `key` until closed, or until this process dies."""
        self._check_open()
        token: Any = self._session.liveliness().declare_token(key)
        return Declaration(token.undeclare)

    def watch_tokens(self, pattern: str, handler: Callable[[Mapping[str, bool]], None]) -> Closable:
        """Call `handler` with added (True) and removed (False) tokens of `pattern`, now and on changes."""
        self._check_open()
        return LivelinessSubscriber(self._session, pattern, handler, self.dispatcher)

    def queryable(self, key: str, handler: Callable[[IncomingQuery], None], *, max_bytes: int) -> Closable:
        """Call `handler` in the loop for every question to `key`; it must answer each, once."""
        self._check_open()
        return RawQueryable(self._session, key, self.dispatcher, handler, max_bytes)

    def querier(self, key: str, *, max_bytes: int) -> RawQuerier:
        """Declare a querier at `key`. Answers longer than `max_bytes` are dropped unread."""
        self._check_open()
        return RawQuerier(self._session, key, self.dispatcher, max_bytes)

    def stop(self) -> None:
        """Stop running handlers and reject declarations: the first half of `close`."""
        self.dispatcher.close()

    async def close(self) -> None:
        """Close. No handler runs afterwards, and all declarations are removed."""
        self.stop()
        if not self._was_left:
            self._was_left = True
            await close_session(self._session)

    def _check_open(self) -> None:
        if self.dispatcher.is_closed:
            raise BusClosedError("the session was closed")

    def _on_connections(self) -> None:
        if self.dispatcher.is_closed:
            return
        self._had_router |= any(self._connections.routers.values())
        previous = self._problem
        self._problem = self.problem
        if self._problem != previous and self.on_change is not None:
            self.on_change()
