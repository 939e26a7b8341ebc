"""Bus on Zenoh: the local broker delivers to readers of this process, Zenoh to all others.

Messages are encoded once per put (*latest*: only while another process reads them) and decoded once per
process (states and events, which are rare: once per subscription). Readers of the same process get the frozen
model itself.
"""

import asyncio
import contextlib
import functools
import logging
import time
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import zenoh
from zenoh import ext
from zenoh.handlers import RingChannel

from pointit.runtime.bus.contract import (
    REQUEST_TIMEOUT_S,
    UNDECLARE_S,
    AnyTopic,
    Closable,
    Declaration,
    Handler,
    Recall,
    Server,
    Subscription,
    Tap,
)
from pointit.runtime.bus.mailbox import Mailbox, TapMailbox
from pointit.runtime.bus.memory_bus import (
    MemoryBus,
    MemoryPublisher,
    Participant,
    RequestHandler,
    no_answer,
    shutting_down,
)
from pointit.runtime.errors import NoAnswerError, RefusedError, RequestError
from pointit.runtime.host.extras import load_object
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.connections import LinkWatch
from pointit.runtime.zenoh.declarations import (
    PRIORITY,
    Declared,
    check_size,
    declare_publisher,
    decoded,
    encoded,
    encoding_of,
    name_from_key,
)
from pointit.runtime.zenoh.liveliness import ZenohWatcher
from pointit.runtime.zenoh.queries import (
    MAX_WAITING,
    ExcessReplies,
    OverflowCounter,
    QueuedQueryable,
    ReplyLimit,
    query_replies,
    refuse,
)
from pointit.runtime.zenoh.session import close_session, open_session
from pointit.runtime.zenoh.sources import CopiedSources, SenderChecks
from pointit.runtime.zenoh.subscribers import (
    EncodedMessage,
    NameAllowlist,
    RetainedStateFetcher,
    SharedSubscriber,
    ZenohSubscription,
    max_names_for,
    recall_for_others,
)
from pointit.schemas import DecodeError, Environment, Message, Query, Reply, SchemaError
from pointit.schemas.problems import MAX_SUBJECT, ROUTER_LOST, Problem
from pointit.schemas.table_types import NAME, PresenceHandler
from pointit.schemas.text import one_line
from pointit.schemas.topics import (
    ACCOUNTS,
    ANY,
    LAMP_COLOR,
    MAP,
    READ_HISTORY,
    Delivery,
    Presence,
    Request,
    Topic,
)

log = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

EVENT_CACHE = 500
"""Number of events that a writer caches for readers that lost their connection."""
HEARTBEAT_S = 0.2
"""Period of sequence numbers published by a writer of states and events. Bounds the time to recover."""

EMPTY_RETRY_S = (0.01, 0.03, 0.1, 0.3)
"""Delays between attempts without an answer, s. A server that was just declared may not be known yet."""

RESTRICTED = "pointit.runtime.zenoh.restricted_bus:RestrictedBus"
"""Class of the bus of a process with credentials."""

MAX_SERVERS = 16
"""Maximum number of replies to one request. More than one server is a mistake, and the first reply counts."""

LIST_S = 1.0
"""Timeout for listing the present names, s. It takes ms."""


class _LatestWriter:
    """Sends the newest message, and none while no other process reads it."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str) -> None:
        self._publisher = declare_publisher(
            session, key, encoding=encoding_of(topic.message), priority=zenoh.Priority.INTERACTIVE_HIGH
        )
        self._has_readers = False  # the listener reports present readers at once
        # No callback of ours here: it would wait for Python's lock on the thread that ends the heartbeats of
        # _RetainedWriter, whose `undeclare` waits for that thread with the lock held, 10 s (Zenoh 1.10).
        self._listener = self._publisher.declare_matching_listener(RingChannel(1))

    def put(self, message: Message) -> None:
        matching = self._listener.try_recv()
        if matching is not None:
            self._has_readers = matching.matching
        if self._has_readers:
            self._publisher.put(encoded(message))

    def undeclare(self) -> None:
        self._listener.undeclare()
        self._publisher.undeclare()


class _RetainedWriter:
    """Sends states and events, and caches the last ones for readers that join late or were disconnected."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str) -> None:
        # The reader counts what it cannot fetch from this cache.
        cache_size = 1 if topic.delivery is Delivery.STATE else EVENT_CACHE
        self._publisher = declare_publisher(
            session,
            key,
            cache=cache_size,
            missed=ext.MissDetectionConfig(heartbeat=HEARTBEAT_S, sporadic_heartbeat=None),
            encoding=encoding_of(topic.message),
            priority=PRIORITY,
        )

    def put(self, message: Message) -> None:
        self._publisher.put(encoded(message))

    def undeclare(self) -> None:
        self._publisher.undeclare()


class ZenohPublisher(MemoryPublisher[M]):
    """Delivers messages to readers of this process, and their bytes through Zenoh to others."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        topic: Topic[M],
        name: str,
        *,
        too_long: dict[str, str],
    ) -> None:
        key = topic.at(name)
        self._writer: _LatestWriter | _RetainedWriter
        if topic.delivery is Delivery.LATEST:
            self._writer = _LatestWriter(session, topic, key)
        else:
            self._writer = _RetainedWriter(session, topic, key)
        self._retires = False
        self._key = key
        self._too_long = too_long
        super().__init__(bus, topic, name, self._send_to_others)

    def _send_to_others(self, message: Message) -> None:
        """Send a message that readers take. Of another one, its sentence is in `too_long` until the next."""
        try:
            self._writer.put(message)
        except SchemaError as error:
            if self._key not in self._too_long:
                log.warning("%s is not sent: %s", self._key, error)
            self._too_long[self._key] = str(error)
            return
        self._too_long.pop(self._key, None)

    def close_nowait(self) -> None:
        """Stop writing. Other processes see the writer until the bus closes, or a moment longer."""
        self._retires = True
        self.close()

    def _undeclare(self) -> None:
        super()._undeclare()
        # Undeclaring a writer of states or events waits for Zenoh's heartbeat and holds Python's lock
        # meanwhile; a callback of ours that waits for that lock on the heartbeat's thread holds both up for
        # 10 s. Where everything ends, closing the session ends the writers without the lock.
        if self._retires:
            asyncio.get_running_loop().call_later(UNDECLARE_S, self._undeclare_writer)
        else:
            self._undeclare_writer()

    def _undeclare_writer(self) -> None:
        if not self._bus.is_closed:
            self._writer.undeclare()


def answer_others(
    session: zenoh.Session, handler: RequestHandler[Q, R], key: str, overflows: OverflowCounter
) -> QueuedQueryable:
    """Answer queries of other processes for `key` with `handler`."""
    request = handler.request

    def answer(query: zenoh.Query) -> Iterable[None]:
        try:
            name = name_from_key(request, str(query.key_expr))
            decoded_query = decoded(request.query, query.payload, query.encoding)
        except SchemaError as error:
            refuse(query, str(error))
        else:
            task = handler.handle(decoded_query, name)
            task.add_done_callback(functools.partial(_reply, request, query))
        return ()

    def check(query: zenoh.Query) -> None:
        check_size(request.query, query.payload)

    busy = f"{request.server} is busy with {MAX_WAITING} other requests for {request.key}; ask later"
    return QueuedQueryable(session, key, answer, overflows, about=request.key, busy=busy, check=check)


def _reply(request: Request[Q, R], query: zenoh.Query, answer: asyncio.Task[R]) -> None:
    if answer.cancelled():
        refuse(query, shutting_down(request))
    elif error := answer.exception():
        refuse(query, str(error))
    else:
        try:
            payload = encoded(answer.result())
        except SchemaError as problem:
            refuse(query, f"{request.server} cannot answer {request.key}: {problem}")
            return
        with query:
            query.reply(str(query.key_expr), payload, encoding=encoding_of(request.reply))


async def send_query(  # noqa: PLR0917 - one call
    session: zenoh.Session,
    request: Request[Q, R],
    key: str,
    query: Q,
    timeout_s: float,
    excess: ExcessReplies | None = None,
) -> R:
    """Return the reply. Without an answer, the query is repeated, since the server may just be starting.

    Raises:
        RequestError: as `Bus.call`.
    """
    try:
        data = encoded(query)
    except SchemaError as error:
        raise RequestError(f"{key} cannot be asked: {error}") from error

    # A server that is starting is not known everywhere yet: without an answer, ask again
    for wait_s in (*EMPTY_RETRY_S, None):
        encoding = encoding_of(type(query))
        replies = await query_replies(
            session,
            key,
            limit=ReplyLimit(MAX_SERVERS, request.reply.max_bytes),
            excess=excess,
            payload=data,
            encoding=encoding,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
        )
        for reply in replies:
            if reply.ok is not None:
                try:
                    result: R = decoded(request.reply, reply.ok.payload, reply.ok.encoding)
                except DecodeError as error:
                    problem = f"{request.server} sent a broken reply to {key}: {error}"
                    raise RequestError(problem) from error
                return result
            if reply.err is not None:
                reason = reply.err.payload.to_bytes().decode(errors="replace")
                if reason != "Timeout":  # Zenoh's own word for it
                    raise RefusedError(one_line(reason))
        if wait_s is not None:
            await asyncio.sleep(wait_s)
    raise no_answer(request, key)


class ZenohBus(MemoryBus):
    """A process on the network; see `pointit.runtime.bus.contract.Bus` for the contract."""

    def __init__(self, session: zenoh.Session, link: Link) -> None:
        """Create a bus on `session`, which the bus closes. Callers normally use `open`."""
        super().__init__()
        self.session = session
        self.link = link
        self._inputs: dict[str, SharedSubscriber] = {}
        self._allowlist = NameAllowlist()
        self._state_fetcher: RetainedStateFetcher | None = None
        self._turned_away = OverflowCounter()
        self._checks = SenderChecks(CopiedSources(str(session.zid())), ExcessReplies())
        self._too_long: dict[str, str] = {}
        """Sentence on the last message of a key, if it was too long to be sent."""
        self._history_turn = asyncio.Lock()
        """Questions for past events go one by one: of several at once, routers of secured sites pass one."""
        self._watch = LinkWatch(session, link, self._on_back) if link.connect else None
        self._is_observer = link.credentials is not None and link.credentials.is_observer
        """True if health and presence of this process are not sent, since the router would refuse them."""

    @classmethod
    async def open(cls, link: Link, *, patience_s: float | None = None) -> "ZenohBus":
        """Return a bus that is connected to `link`, with credentials one that knows its rights.

        Raises:
            BusError: As `open_session`.
            ConfigError: As `open_session`, or if there are credentials and this build joins no secured site.
        """
        if link.credentials is None or not link.connect:
            return cls(await open_session(link, patience_s=patience_s), link)
        restricted: Callable[..., ZenohBus] = load_object(RESTRICTED, "joining a secured site")
        return restricted(await open_session(link, patience_s=patience_s), link, link.credentials)

    @property
    def connected(self) -> bool:
        """Return True if the router is connected, or if the bus needs none."""
        return self._watch is None or self._watch.up

    @property
    def site(self) -> str:
        """Return the name of the site that was joined."""
        return self.link.site

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Return that the router is lost, or else what is refused of others."""
        if self._watch is not None:
            loss = self._watch.problem
            if loss:
                subject = self._watch.where[:MAX_SUBJECT]
                return (Problem(code=ROUTER_LOST, sentence=loss, subject=subject),)
        now_s = time.monotonic()
        sentences = {
            "rejected": self._turned_away.problem(now_s),
            "excess-replies": self._checks.excess.problem(now_s),
            "copied-source": self._checks.sources.problem(now_s),
        }
        problems = [Problem(code=code, sentence=text) for code, text in sentences.items() if text]
        for key, text in self._too_long.items():
            sentence = f"{key} is not sent: {text}; readers have what was sent before"
            problems.append(Problem(code="too-long", sentence=sentence, subject=key[:MAX_SUBJECT]))
        return tuple(problems)

    def publisher(self, topic: Topic[M], name: str = "") -> MemoryPublisher[M]:
        """Declare a writer of `topic.at(name)`."""
        self._check_open()
        if topic in ACCOUNTS and self._is_observer:
            return super().publisher(topic, name)
        key = topic.at(name)
        if topic not in ACCOUNTS:
            self._add_right("writes", key)
        self._checks.sources.add_own_key(key)
        return ZenohPublisher(self, self.session, topic, name, too_long=self._too_long)

    def subscribe(
        self,
        topic: Topic[M],
        handler: Handler[M],
        name: str = ANY,
        *,
        retained: bool = True,
        queue_all: bool = False,
    ) -> Subscription:
        """Call `handler(message, name)` for what arrives."""
        self._check_open()

        def on_map(message: M, map_name: str) -> None:
            if isinstance(message, Environment):
                self._allowlist.keep(LAMP_COLOR.placeholder, (lamp.id for lamp in message.lamps))
            handler(message, map_name)

        # A map names its lamps: their colours are never refused as those of too many names
        map_handler = on_map if topic is MAP else handler
        mailbox = Mailbox(
            topic, map_handler, self.dispatcher, EncodedMessage.decode, retained=retained, queue_all=queue_all
        )
        return self._read(topic, mailbox, name, retained=retained)

    def tap(self, topic: AnyTopic, handler: Tap, name: str = ANY) -> Subscription:
        """Call `handler` for every message at once, on the loop's thread or Zenoh's."""
        self._check_open()
        return self._read(topic, TapMailbox(topic, handler, self.dispatcher), name, retained=True)

    def _read(self, topic: AnyTopic, mailbox: Mailbox, name: str, *, retained: bool) -> Subscription:
        self._add_right("reads", topic.at(name))
        subscription = ZenohSubscription(
            self,
            self.session,
            topic,
            mailbox,
            name,
            inputs=self._inputs,
            allowlist=self._allowlist,
            checks=self._checks,
        )
        if topic.delivery is Delivery.STATE and retained:
            if self._state_fetcher is None:
                self._state_fetcher = RetainedStateFetcher(self, self.session, self._checks.excess)
            self._state_fetcher.fetch(topic, name, mailbox)
        return subscription

    def serve_retained(self, topics: Sequence[AnyTopic], recall: Recall) -> Closable:
        """Answer for the writers of `topics` that are gone, here and to other processes."""
        local = super().serve_retained(topics, recall)
        queryables = recall_for_others(self.session, topics, recall, self._turned_away)
        return self._join(local, *queryables)

    def serve(self, request: Request[Q, R], server: Server[Q, R], name: str = ANY) -> Closable:
        """Answer `request`, here and from other processes."""
        local = self.handler(request, server, name)
        key = request.at(name)
        self._add_right("serves", key)
        return self._join(local, answer_others(self.session, local, key, self._turned_away))

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply of the server of `request`, in this process or another."""
        self._check_open()
        if self.exchange.handler_for(request, name) is not None:
            return await super().call(request, query, name, timeout_s=timeout_s)
        key = request.at(name)
        if not self.connected:
            raise NoAnswerError(f"{request.server} cannot be asked for {key}: {self.problem}")

        async def ask() -> R:
            async with self._history_turn if request is READ_HISTORY else contextlib.nullcontext():
                return await send_query(self.session, request, key, query, timeout_s, self._checks.excess)

        reply = self.spawn(ask(), f"call {key}")
        try:
            return await self._wait_for(reply, request, key, timeout_s)
        finally:
            reply.cancel()

    def announce(self, presence: Presence, name: str) -> Closable:
        """Be present under `name` until closed, or until this process dies."""
        local = super().announce(presence, name)
        if self._is_observer:
            return local
        token = self.session.liveliness().declare_token(presence.at(name))
        return self._join(local, token)

    def watch(self, presence: Presence, handler: PresenceHandler) -> Closable:
        """Call `handler(name, present=…)` now and on every change."""
        self._check_open()
        watcher = ZenohWatcher(self, self.session, presence, handler)
        if self._is_observer:
            for name in self.exchange.present.get(presence.key, {}):
                self._loop.call_soon(functools.partial(watcher.notify, name, present=True))
        return watcher

    async def list_present(self, presence: Presence) -> set[str]:
        """Return all names that are present now, here and elsewhere."""
        limit = ReplyLimit(max_names_for(presence.placeholder), max_of_key=1)
        tokens = await query_replies(self.session.liveliness(), presence.at(ANY), limit=limit, timeout=LIST_S)
        names = set[str]()
        for token in tokens:
            if token.ok is not None:
                names.add(presence.name_in(str(token.ok.key_expr)))
        valid_names = set(filter(NAME.match, names))
        return valid_names | await super().list_present(presence)

    def _notify_watchers(self, presence: Presence, name: str, *, present: bool) -> None:
        if self._is_observer:
            super()._notify_watchers(presence, name, present=present)
        elif not present:  # Zenoh reports all other names
            for watcher in self.exchange.watchers.get(presence.key, ()):
                if isinstance(watcher, ZenohWatcher):
                    self._loop.call_soon(watcher.notify_departure, name)

    async def close(self) -> None:
        """Close everything that was declared here, and the session."""
        if self._closed.done():
            return
        if self._watch is not None:
            self._watch.close()
        if self._state_fetcher is not None:
            self._state_fetcher.close()
        await super().close()
        await close_session(self.session)

    def _join(self, local: Closable, *declarations: Declared) -> Closable:
        """Return a declaration that closes `local`, in this process, and `declarations`, in the session."""

        def undo() -> None:
            local.close()
            for declaration in declarations:
                declaration.undeclare()

        return Declaration(undo, self.declarations)

    def _add_right(self, verb: str, key: str) -> None:
        """Note that a right is used. Without access rules all are granted."""

    def _on_back(self) -> None:
        """Note that a lost router is back."""
