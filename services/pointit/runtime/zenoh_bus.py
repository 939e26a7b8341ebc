# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""The bus on Zenoh: the in-process exchange for readers of this process, Zenoh for all others.

Messages are encoded once a put and decoded once a process; readers of the same process get the frozen
model itself. Zenoh's callbacks arrive on its threads and only fill mailboxes.
"""

import asyncio
import logging
import os
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import zenoh
from zenoh import ext
from zenoh.handlers import Callback

from pointit.runtime.bus import REQUEST_TIMEOUT_S, AnyTopic, Closable, Handler, Server, Subscription
from pointit.runtime.errors import BusClosedError, RefusedError
from pointit.runtime.mailbox import Mailbox
from pointit.runtime.memory_bus import (
    Declaration,
    MailboxSubscription,
    MemoryBus,
    MemoryPublisher,
    answer,
    no_answer,
)
from pointit.runtime.zenoh_session import Link, LinkWatch, open_session
from pointit.schemas import DecodeError, Message, Query, Reply, decode, encode
from pointit.schemas.base import Part
from pointit.schemas.codec import MEDIA_TYPE
from pointit.schemas.topics import ANY, Delivery, Presence, Request, Topic

log = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

EVENT_CACHE = 500
"""Events a writer keeps for readers that were cut off."""

HEARTBEAT_S = 0.2
"""How often a writer of states and events tells its last sequence number: bounds the time to recover."""

EMPTY_RETRY_S = (0.01, 0.03, 0.1, 0.3)
"""Waits between tries when nobody answered: a server that was just declared may not be known yet."""

MAX_IN_FLIGHT = 64
"""Requests that one server works on at a time."""


class _Undeclarable(Protocol):
    def undeclare(self) -> None: ...


class _Writer(_Undeclarable, Protocol):
    def put(self, payload: bytes, *, attachment: bytes | None = None) -> None: ...


def _encoding(kind: type[Message] | type[Query]) -> zenoh.Encoding:
    return zenoh.Encoding(MEDIA_TYPE).with_schema(kind.schema_name())


def _decode(kind: type[Any], sample: Any) -> Any:
    return decode(kind, sample.payload.to_bytes(), str(sample.encoding).partition(";")[2])


class ZenohPublisher(MemoryPublisher[M]):
    """Hands messages to this process's readers, and their bytes to Zenoh for the others."""

    def __init__(self, bus: "ZenohBus", topic: Topic[M], name: str) -> None:
        super().__init__(bus, topic, name)
        self._attachment = None if topic.delivery is Delivery.LATEST else bus.identity
        self._writer = _declare_writer(bus.session, topic, topic.at(name))
        self._remote = Declaration(bus, self._writer.undeclare)

    def put(self, message: M) -> None:
        """Send `message`."""
        super().put(message)
        self._writer.put(encode(message), attachment=self._attachment)

    def close(self) -> None:
        """Undeclare; a state's last value goes with its writer."""
        super().close()
        self._remote.close()


def _declare_writer(session: zenoh.Session, topic: AnyTopic, key: str) -> _Writer:
    if topic.delivery is Delivery.LATEST:
        return session.declare_publisher(
            key,
            encoding=_encoding(topic.message),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            allowed_destination=zenoh.Locality.REMOTE,
        )
    # BLOCK would let one stuck reader stop this process for seconds; what DROP loses is fetched again
    # from the writer's cache, and what cannot be fetched is counted.
    return ext.declare_advanced_publisher(
        session,
        key,
        encoding=_encoding(topic.message),
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.DATA_HIGH,
        allowed_destination=zenoh.Locality.REMOTE,
        cache=ext.CacheConfig(1 if topic.delivery is Delivery.STATE else EVENT_CACHE),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=HEARTBEAT_S, sporadic_heartbeat=None),
        publisher_detection=True,
    )


class ZenohSubscription(MailboxSubscription):
    """A mailbox that is filled by this process's writers and by Zenoh."""

    def __init__(self, bus: "ZenohBus", topic: AnyTopic, mailbox: Mailbox, name: str) -> None:
        super().__init__(bus, topic, mailbox, name)
        identity = bus.identity

        def on_sample(sample: zenoh.Sample) -> None:  # on Zenoh's thread
            if sample.kind != zenoh.SampleKind.PUT:
                return
            attachment = sample.attachment
            if attachment is not None and attachment.to_bytes() == identity:
                return  # our own state, fetched back from our own cache
            mailbox.offer(topic.name_in(str(sample.key_expr)), sample)

        key = topic.at(name) if topic.placeholder else topic.at()
        remotes: list[_Undeclarable] = []
        if topic.delivery is Delivery.LATEST:
            remotes.append(
                bus.session.declare_subscriber(
                    key, Callback(on_sample, indirect=False), allowed_origin=zenoh.Locality.REMOTE
                )
            )
        else:
            history = ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
            subscriber = ext.declare_advanced_subscriber(
                bus.session,
                key,
                Callback(on_sample, indirect=False),
                history=history if topic.delivery is Delivery.STATE else None,
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                allowed_origin=zenoh.Locality.REMOTE,
            )
            remotes.append(subscriber)
            if topic.delivery is Delivery.EVENT:

                def on_miss(miss: ext.Miss) -> None:  # on Zenoh's thread
                    mailbox.traffic.lost += miss.nb
                    log.warning("%s: %d events never arrived", topic.key, miss.nb)

                remotes.insert(0, subscriber.sample_miss_listener(Callback(on_miss, indirect=False)))

        def undeclare() -> None:
            mailbox.close()
            for remote in remotes:
                remote.undeclare()

        self._remote = Declaration(bus, undeclare)

    def close(self) -> None:
        """Undeclare; the handler does not run any more."""
        super().close()
        self._remote.close()


class ZenohBus(MemoryBus):
    """A process on the network; see `pointit.runtime.bus.Bus` for the contract."""

    def __init__(self, session: zenoh.Session, link: Link) -> None:
        """Use `session`, which the bus closes; `open` is the usual way in."""
        super().__init__()
        self.session = session
        self.link = link
        self.identity = os.urandom(8)
        self.connected = True
        self._loop = asyncio.get_running_loop()
        self._replies: set[asyncio.Task[None]] = set()
        if link.connect:
            watch = LinkWatch(session, link, self._link_changed)
            Declaration(self, watch.close)

    @classmethod
    async def open(cls, link: Link, *, patience_s: float | None = None) -> "ZenohBus":
        """Return a bus that has joined `link`; see `open_session` for what is raised."""
        return cls(await open_session(link, patience_s=patience_s), link)

    def publisher(self, topic: Topic[M], name: str = "") -> ZenohPublisher[M]:
        """Declare a writer of `topic.at(name)`."""
        self._check_open()
        return ZenohPublisher(self, topic, name)

    def subscribe(self, topic: Topic[M], handler: Handler[M], name: str = ANY) -> Subscription:
        """Call `handler(message, name)` for what arrives."""
        self._check_open()

        def unpack(sample: Any) -> Message:
            message: Message = _decode(topic.message, sample)
            return message

        return ZenohSubscription(self, topic, Mailbox(topic, handler, self.dispatcher, unpack), name)

    def serve(self, request: Request[Q, R], server: Server[Q, R], name: str = ANY) -> Closable:
        """Answer `request`, here and from other processes."""
        local = super().serve(request, server, name)
        slots = asyncio.Semaphore(MAX_IN_FLIGHT)

        async def reply(query: zenoh.Query) -> None:
            with query:  # dropped in every case: otherwise the caller waits for its time-out
                key = str(query.key_expr)
                try:
                    payload = query.payload
                    asked = decode(request.query, payload.to_bytes() if payload is not None else b"")
                    async with slots:
                        done = await answer(request, server, asked, request.name_in(key))
                    query.reply(key, encode(done), encoding=_encoding(request.reply))
                except (RefusedError, DecodeError) as error:
                    query.reply_err(str(error).encode())
                except asyncio.CancelledError:
                    query.reply_err(f"{request.server} is shutting down".encode())
                    raise

        def start(query: zenoh.Query) -> None:
            if self._closed:
                query.drop()
                return
            task = self._loop.create_task(reply(query), name=f"serve {request.key}")
            self._replies.add(task)
            task.add_done_callback(self._replies.discard)

        def on_query(query: zenoh.Query) -> None:  # on Zenoh's thread
            try:
                self._loop.call_soon_threadsafe(start, query)
            except RuntimeError:  # the loop is gone
                query.drop()

        queryable = self.session.declare_queryable(
            request.at(name) if request.placeholder else request.at(),
            Callback(on_query, indirect=False),
            complete=True,
            allowed_origin=zenoh.Locality.REMOTE,
        )

        def undo() -> None:
            local.close()
            queryable.undeclare()

        return Declaration(self, undo)

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply of whoever serves `request`, in this process or another."""
        self._check_open()
        key = request.at(name)
        if self.exchange.server_of(request, name) is not None:
            return await super().call(request, query, name, timeout_s=timeout_s)
        return await self.in_time(request, key, self._ask(request, key, query, timeout_s), timeout_s)

    def announce(self, presence: Presence, name: str) -> Closable:
        """Be present under `name` until closed, or until this process dies."""
        self._check_open()
        return Declaration(self, self.session.liveliness().declare_token(presence.at(name)).undeclare)

    def watch(self, presence: Presence, handler: Callable[[str, bool], None]) -> Closable:
        """Call `handler(name, present)` now and on every change."""
        self._check_open()
        known: set[str] = set()
        live = True

        def tell(name: str, present: bool) -> None:  # noqa: FBT001
            if live and present != (name in known):
                (known.add if present else known.discard)(name)
                handler(name, present)

        def on_change(sample: zenoh.Sample) -> None:  # on Zenoh's thread
            name = presence.name_in(str(sample.key_expr))
            try:
                self._loop.call_soon_threadsafe(tell, name, sample.kind == zenoh.SampleKind.PUT)
            except RuntimeError:  # the loop is gone
                log.debug("presence of %s changed after the loop ended", name)

        subscriber = self.session.liveliness().declare_subscriber(
            presence.at(ANY), Callback(on_change, indirect=False), history=True
        )

        def undo() -> None:
            nonlocal live
            live = False
            subscriber.undeclare()

        return Declaration(self, undo)

    async def close(self) -> None:
        """Close everything that was declared here, and the session."""
        if self._closed:
            return
        for task in list(self._replies):
            task.cancel()
        if self._replies:
            await asyncio.gather(*self._replies, return_exceptions=True)
        await super().close()
        await asyncio.to_thread(self.session.close)

    async def _ask(self, request: Request[Q, R], key: str, query: Q, timeout_s: float) -> R:
        """Ask over Zenoh; an empty answer is tried again: the server may just be arriving."""
        for wait_s in (*EMPTY_RETRY_S, None):
            replies = await self._get(key, query, timeout_s)
            for reply in replies:
                if reply.ok is not None:
                    result: R = _decode(request.reply, reply.ok)
                    return result
            for reply in replies:
                if reply.err is not None:
                    reason = reply.err.payload.to_bytes().decode(errors="replace")
                    if reason != "Timeout":
                        raise RefusedError(reason)
            if wait_s is not None:
                await asyncio.sleep(wait_s)
        raise no_answer(request, key)

    async def _get(self, key: str, query: Part, timeout_s: float) -> list[zenoh.Reply]:
        done = asyncio.Event()
        replies: list[zenoh.Reply] = []

        def finish() -> None:  # on Zenoh's thread
            try:
                self._loop.call_soon_threadsafe(done.set)
            except RuntimeError:  # the loop is gone
                log.debug("reply to %s came after the loop ended", key)

        token = zenoh.CancellationToken()
        self.session.get(
            key,
            Callback(replies.append, finish, indirect=False),
            payload=encode(query),
            timeout=timeout_s,
            cancellation_token=token,
        )
        try:
            await done.wait()
        except asyncio.CancelledError:
            self._loop.run_in_executor(None, token.cancel)
            raise
        return replies

    def _link_changed(self, up: bool) -> None:  # noqa: FBT001
        self.connected = up

    def _check_open(self) -> None:
        if self._closed:
            raise BusClosedError("the bus is closed")
