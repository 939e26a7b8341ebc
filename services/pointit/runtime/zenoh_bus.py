# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""The bus on Zenoh: the in-process exchange for readers of this process, Zenoh for all others.

Messages are encoded once a put (*latest*: only while somebody elsewhere reads) and decoded once a process;
readers of the same process get the frozen model itself. Zenoh's callbacks arrive on its threads and only
fill mailboxes.
"""

import asyncio
import contextlib
import functools
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import zenoh
from zenoh import ext
from zenoh.handlers import Callback

from pointit.runtime.bus import REQUEST_TIMEOUT_S, AnyTopic, Closable, Handler, Server, Subscription
from pointit.runtime.errors import RefusedError, RequestError
from pointit.runtime.mailbox import Mailbox
from pointit.runtime.memory_bus import (
    Declaration,
    Desk,
    MailboxSubscription,
    MemoryBus,
    MemoryPublisher,
    Watcher,
    no_answer,
    shutting_down,
)
from pointit.runtime.zenoh_session import Link, LinkWatch, close_session, open_session
from pointit.schemas import DecodeError, Message, Query, Reply, SchemaError, decode, encode
from pointit.schemas.codec import MEDIA_TYPE
from pointit.schemas.topics import ANY, Delivery, Presence, Request, Topic, check_name

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

EVENT_CACHE = 500
"""Events a writer keeps for readers that were cut off."""

HEARTBEAT_S = 0.2
"""How often a writer of states and events tells its last sequence number: bounds the time to recover."""

EMPTY_RETRY_S = (0.01, 0.03, 0.1, 0.3)
"""Waits between tries when nobody answered: a server that was just declared may not be known yet."""

PRIORITY = zenoh.Priority.DATA_HIGH
"""Of states and events as they are put; what is fetched again from a writer's cache has another one."""

NAMES = 1024
"""Keys whose names a subscription remembers."""


class _Undeclarable(Protocol):
    def undeclare(self) -> None: ...


def _encoding(kind: type[Message] | type[Query]) -> zenoh.Encoding:
    return zenoh.Encoding(MEDIA_TYPE).with_schema(kind.schema_name())


def _decode(kind: type[Any], payload: zenoh.ZBytes | None, encoding: zenoh.Encoding | None) -> Any:
    schema = "" if encoding is None else str(encoding).partition(";")[2]
    return decode(kind, b"" if payload is None else payload.to_bytes(), schema)


def _name_in(row: AnyTopic | Request[Any, Any] | Presence, key: str) -> str:
    """Return the name in a key that somebody else wrote; raises `SchemaError` if it cannot be one."""
    name = row.name_in(key)
    if row.placeholder:
        check_name(name, row.placeholder)
    return name


class _LatestWriter:
    """Sends the newest, and nothing at all while nobody elsewhere reads it."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str) -> None:
        self._publisher = session.declare_publisher(
            key,
            encoding=_encoding(topic.message),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        self._wanted = False  # the listener tells at once if there is somebody
        self._listener = self._publisher.declare_matching_listener(
            Callback(self._on_matching, indirect=False)
        )

    def put(self, message: Message) -> None:
        if self._wanted:
            self._publisher.put(encode(message))

    def undeclare(self) -> None:
        self._listener.undeclare()
        self._publisher.undeclare()

    def _on_matching(self, status: zenoh.MatchingStatus) -> None:  # on Zenoh's thread
        self._wanted = status.matching


class _KeptWriter:
    """Sends states and events, and keeps the last of them for readers that come late or were cut off."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str) -> None:
        # BLOCK would let one stuck reader stop this process for seconds; what DROP loses is fetched again
        # from this cache, and what cannot be fetched is counted by the reader.
        self._publisher = ext.declare_advanced_publisher(
            session,
            key,
            encoding=_encoding(topic.message),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=PRIORITY,
            allowed_destination=zenoh.Locality.REMOTE,
            cache=ext.CacheConfig(1 if topic.delivery is Delivery.STATE else EVENT_CACHE),
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=HEARTBEAT_S, sporadic_heartbeat=None),
            publisher_detection=True,
        )

    def put(self, message: Message) -> None:
        self._publisher.put(encode(message))

    def undeclare(self) -> None:
        self._publisher.undeclare()


class ZenohPublisher(MemoryPublisher[M]):
    """Hands messages to this process's readers, and their bytes to Zenoh for the others."""

    def __init__(self, bus: "ZenohBus", topic: Topic[M], name: str) -> None:
        key = topic.at(name)
        self._writer = (
            _LatestWriter(bus.session, topic, key)
            if topic.delivery is Delivery.LATEST
            else _KeptWriter(bus.session, topic, key)
        )
        super().__init__(bus, topic, name)

    def put(self, message: M) -> None:
        """Send `message`."""
        super().put(message)
        self._writer.put(message)

    def _undeclare(self) -> None:
        super()._undeclare()
        self._writer.undeclare()


class ZenohSubscription(MailboxSubscription):
    """A mailbox that is filled by this process's writers and by Zenoh."""

    def __init__(self, bus: "ZenohBus", topic: AnyTopic, mailbox: Mailbox, name: str) -> None:
        super().__init__(bus, topic, mailbox, name)
        key = topic.at(name)
        self._remotes: list[_Undeclarable] = []
        self._name_in = functools.lru_cache(maxsize=NAMES)(functools.partial(_name_in, topic))
        if topic.delivery is Delivery.LATEST:
            self._remotes.append(
                bus.session.declare_subscriber(
                    key, Callback(self._on_sample, indirect=False), allowed_origin=zenoh.Locality.REMOTE
                )
            )
            return
        self._zid = bus.session.info.zid()
        self._began = bus.session.new_timestamp()
        is_event = topic.delivery is Delivery.EVENT
        subscriber = ext.declare_advanced_subscriber(
            bus.session,
            key,
            Callback(self._on_event if is_event else self._on_state, indirect=False),
            history=None if is_event else ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
            recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        self._remotes.append(subscriber)
        if is_event:

            def on_miss(miss: ext.Miss) -> None:
                mailbox.lose(miss.nb)

            self._remotes.insert(0, subscriber.sample_miss_listener(Callback(on_miss, indirect=False)))

    def _undeclare(self) -> None:
        super()._undeclare()
        for remote in self._remotes:
            remote.undeclare()

    # All three run on Zenoh's threads.

    def _on_sample(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        key = str(sample.key_expr)
        try:
            name = self._name_in(key)
        except SchemaError as error:
            self._mailbox.reject(error)
        else:
            self._mailbox.offer(name, sample)

    def _on_state(self, sample: zenoh.Sample) -> None:
        source = sample.source_info
        if source is not None and source.source_id.zid == self._zid:
            return  # our own, fetched from our own cache when a lost router is back
        self._on_sample(sample)

    def _on_event(self, sample: zenoh.Sample) -> None:
        # A writer that is heard for the first time makes Zenoh fetch everything it has kept: a button that
        # was pressed a minute ago must not be pressed now. What comes live is taken whatever its clock says.
        stamp = sample.timestamp
        if sample.priority != PRIORITY and stamp is not None and not stamp >= self._began:
            return
        self._on_state(sample)


class ZenohDesk(Desk[Q, R]):
    """Answers this process's callers, and those of others."""

    def __init__(self, bus: "ZenohBus", request: Request[Q, R], server: Server[Q, R], name: str) -> None:
        super().__init__(bus, request, server, name)
        self._loop = asyncio.get_running_loop()
        self._open = True
        self._queryable = bus.session.declare_queryable(
            request.at(name),
            Callback(self._on_query, indirect=False),
            complete=True,
            allowed_origin=zenoh.Locality.REMOTE,
        )

    def _undeclare(self) -> None:
        self._open = False
        super()._undeclare()
        self._queryable.undeclare()

    def _on_query(self, query: zenoh.Query) -> None:  # on Zenoh's thread
        try:
            self._loop.call_soon_threadsafe(self._receive, query)
        except RuntimeError:  # the loop is gone
            query.drop()

    def _receive(self, query: zenoh.Query) -> None:
        if not self._open:
            query.drop()
            return
        try:
            name = _name_in(self.request, str(query.key_expr))
            asked = _decode(self.request.query, query.payload, query.encoding)
        except SchemaError as error:
            with query:
                query.reply_err(str(error).encode())
        else:
            self.start(asked, name).add_done_callback(functools.partial(self._reply, query))

    def _reply(self, query: zenoh.Query, answer: asyncio.Task[R]) -> None:
        with query:  # dropped in every case: otherwise the caller waits for its time-out
            if answer.cancelled():
                query.reply_err(shutting_down(self.request).encode())
                return
            error = answer.exception()
            if error is None:
                payload = encode(answer.result())
                query.reply(str(query.key_expr), payload, encoding=_encoding(self.request.reply))
            else:
                query.reply_err(str(error).encode())


class ZenohWatcher(Watcher):
    """Tells who is present here or elsewhere."""

    def __init__(self, bus: "ZenohBus", presence: Presence, handler: Callable[[str, bool], None]) -> None:
        super().__init__(bus, presence, handler)
        self._loop = asyncio.get_running_loop()
        self._here = bus.exchange.present.setdefault(presence.key, {})
        self._withheld: set[str] = set()
        """Names of which Zenoh has said that they are gone, while this process still announces them."""
        self._subscriber = bus.session.liveliness().declare_subscriber(
            presence.at(ANY), Callback(self._on_change, indirect=False), history=True
        )

    def tell_withheld(self, name: str) -> None:
        """Say that `name` is gone if only this process still announced it."""
        if name in self._withheld:
            self._change(name, False)

    def _undeclare(self) -> None:
        super()._undeclare()
        self._subscriber.undeclare()

    def _on_change(self, sample: zenoh.Sample) -> None:  # on Zenoh's thread
        with contextlib.suppress(SchemaError, RuntimeError):  # not a name of ours; the loop is gone
            name = _name_in(self.presence, str(sample.key_expr))
            self._loop.call_soon_threadsafe(self._change, name, sample.kind == zenoh.SampleKind.PUT)

    def _change(self, name: str, present: bool) -> None:  # noqa: FBT001
        if not present and name in self._here:
            self._withheld.add(name)
            return
        self._withheld.discard(name)
        self.tell(name, present)


class ZenohBus(MemoryBus):
    """A process on the network; see `pointit.runtime.bus.Bus` for the contract."""

    def __init__(self, session: zenoh.Session, link: Link) -> None:
        """Use `session`, which the bus closes; `open` is the usual way in."""
        super().__init__()
        self.session = session
        self.link = link
        self._watch = LinkWatch(session, link) if link.connect else None

    @classmethod
    async def open(cls, link: Link, *, patience_s: float | None = None) -> "ZenohBus":
        """Return a bus that has joined `link`; see `open_session` for what is raised."""
        return cls(await open_session(link, patience_s=patience_s), link)

    @property
    def connected(self) -> bool:
        """Return whether there is a router, for a bus that needs one."""
        return self._watch is None or self._watch.up

    @property
    def trouble(self) -> str:
        """Return that the router is lost, if it is."""
        return "" if self._watch is None else self._watch.trouble

    def publisher(self, topic: Topic[M], name: str = "") -> ZenohPublisher[M]:
        """Declare a writer of `topic.at(name)`."""
        self._check_open()
        return ZenohPublisher(self, topic, name)

    def subscribe(self, topic: Topic[M], handler: Handler[M], name: str = ANY) -> Subscription:
        """Call `handler(message, name)` for what arrives."""
        self._check_open()

        def unpack(sample: zenoh.Sample) -> Message:
            message: Message = _decode(topic.message, sample.payload, sample.encoding)
            return message

        return ZenohSubscription(self, topic, Mailbox(topic, handler, self.dispatcher, unpack), name)

    def serve(self, request: Request[Q, R], server: Server[Q, R], name: str = ANY) -> Closable:
        """Answer `request`, here and from other processes."""
        self._check_open()
        return ZenohDesk(self, request, server, name)

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply of whoever serves `request`, in this process or another."""
        self._check_open()
        if self.exchange.desk_of(request, name) is not None:
            return await super().call(request, query, name, timeout_s=timeout_s)
        key = request.at(name)
        reply = self.spawn(self._ask(request, key, query, timeout_s), f"call {key}")
        try:
            return await self._wait_for(reply, request, key, timeout_s)
        finally:
            reply.cancel()

    def announce(self, presence: Presence, name: str) -> Closable:
        """Be present under `name` until closed, or until this process dies."""
        here = super().announce(presence, name)
        token = self.session.liveliness().declare_token(presence.at(name))

        def undo() -> None:
            here.close()
            token.undeclare()

        return Declaration(self, undo)

    def watch(self, presence: Presence, handler: Callable[[str, bool], None]) -> Closable:
        """Call `handler(name, present)` now and on every change."""
        self._check_open()
        return ZenohWatcher(self, presence, handler)

    def _tell(self, presence: Presence, name: str, present: bool) -> None:  # noqa: FBT001
        if not present:  # all else is told by Zenoh
            for watcher in self.exchange.watchers.get(presence.key, ()):
                if isinstance(watcher, ZenohWatcher):
                    self._loop.call_soon(watcher.tell_withheld, name)

    async def close(self) -> None:
        """Close everything that was declared here, and the session."""
        if self._closed.done():
            return
        if self._watch is not None:
            self._watch.close()
        await super().close()
        await close_session(self.session)

    async def _ask(self, request: Request[Q, R], key: str, query: Q, timeout_s: float) -> R:
        """Ask over Zenoh; an empty answer is tried again: the server may just be arriving."""
        for wait_s in (*EMPTY_RETRY_S, None):
            for reply in await self._get(key, query, timeout_s):
                if reply.ok is not None:
                    try:
                        result: R = _decode(request.reply, reply.ok.payload, reply.ok.encoding)
                    except DecodeError as error:
                        raise RequestError(
                            f"{request.server} sent a broken reply to {key}: {error}"
                        ) from error
                    return result
                if reply.err is not None:
                    reason = reply.err.payload.to_bytes().decode(errors="replace")
                    if reason != "Timeout":  # Zenoh's own word for it
                        raise RefusedError(reason)
            if wait_s is not None:
                await asyncio.sleep(wait_s)
        raise no_answer(request, key)

    async def _get(self, key: str, query: Query, timeout_s: float) -> list[zenoh.Reply]:
        done = asyncio.Event()
        replies: list[zenoh.Reply] = []

        def finish() -> None:  # on Zenoh's thread
            with contextlib.suppress(RuntimeError):  # the loop is gone
                self._loop.call_soon_threadsafe(done.set)

        token = zenoh.CancellationToken()
        self.session.get(
            key,
            Callback(replies.append, finish, indirect=False),
            payload=encode(query),
            encoding=_encoding(type(query)),
            timeout=timeout_s,
            cancellation_token=token,
        )
        try:
            await done.wait()
        except asyncio.CancelledError:
            self._loop.run_in_executor(None, token.cancel)
            raise
        return replies
