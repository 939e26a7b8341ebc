# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Writing and reading topics over Zenoh; its callbacks arrive on its threads and only fill mailboxes."""

import functools
from typing import Protocol, TypeVar

import zenoh
from zenoh import ext
from zenoh.handlers import Callback, RingChannel

from pointit.runtime.bus import AnyTopic
from pointit.runtime.mailbox import Mailbox
from pointit.runtime.memory_bus import MailboxSubscription, MemoryBus, MemoryPublisher
from pointit.runtime.zenoh_wire import encoding_of, name_in
from pointit.schemas import Message, SchemaError, encode
from pointit.schemas.topics import Delivery, Topic

M = TypeVar("M", bound=Message)

EVENT_CACHE = 500
"""Events a writer keeps for readers that were cut off."""

HEARTBEAT_S = 0.2
"""How often a writer of states and events tells its last sequence number: bounds the time to recover."""

PRIORITY = zenoh.Priority.DATA_HIGH
"""Of states and events as they are put; what is fetched again from a writer's cache has another one."""

NAMES = 1024
"""Keys whose names a subscription remembers."""


class _Undeclarable(Protocol):
    def undeclare(self) -> None: ...


class _LatestWriter:
    """Sends the newest, and nothing at all while nobody elsewhere reads it."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str) -> None:
        self._publisher = session.declare_publisher(
            key,
            encoding=encoding_of(topic.message),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        self._wanted = False  # the listener tells at once if there is somebody
        # No callback of ours here: it would wait for Python's lock on the thread that ends the heartbeats of
        # _KeptWriter, whose `undeclare` waits for that thread with the lock held, 10 s (Zenoh 1.10).
        self._listener = self._publisher.declare_matching_listener(RingChannel(1))

    def put(self, message: Message) -> None:
        news = self._listener.try_recv()
        if news is not None:
            self._wanted = news.matching
        if self._wanted:
            self._publisher.put(encode(message))

    def undeclare(self) -> None:
        self._listener.undeclare()
        self._publisher.undeclare()


class _KeptWriter:
    """Sends states and events, and keeps the last of them for readers that come late or were cut off."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str) -> None:
        # BLOCK would let one stuck reader stop this process for seconds; what DROP loses is fetched again
        # from this cache, and what cannot be fetched is counted by the reader.
        self._publisher = ext.declare_advanced_publisher(
            session,
            key,
            encoding=encoding_of(topic.message),
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

    def __init__(self, bus: MemoryBus, session: zenoh.Session, topic: Topic[M], name: str) -> None:
        key = topic.at(name)
        self._writer = (
            _LatestWriter(session, topic, key)
            if topic.delivery is Delivery.LATEST
            else _KeptWriter(session, topic, key)
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

    def __init__(
        self, bus: MemoryBus, session: zenoh.Session, topic: AnyTopic, mailbox: Mailbox, name: str
    ) -> None:
        super().__init__(bus, topic, mailbox, name)
        key = topic.at(name)
        self._remotes: list[_Undeclarable] = []
        self._name_in = functools.lru_cache(maxsize=NAMES)(functools.partial(name_in, topic))
        if topic.delivery is Delivery.LATEST:
            self._remotes.append(
                session.declare_subscriber(
                    key, Callback(self._on_sample, indirect=False), allowed_origin=zenoh.Locality.REMOTE
                )
            )
            return
        self._zid = session.info.zid()
        self._began = session.new_timestamp()
        is_event = topic.delivery is Delivery.EVENT
        subscriber = ext.declare_advanced_subscriber(
            session,
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
