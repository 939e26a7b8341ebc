# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Writing topics over Zenoh: to this process's readers as messages, to all others as bytes."""

import asyncio
from typing import TypeVar

import zenoh
from zenoh import ext
from zenoh.handlers import RingChannel

from pointit.runtime.bus.contract import UNDECLARE_S, AnyTopic
from pointit.runtime.bus.endpoints import MemoryPublisher
from pointit.runtime.bus.local_broker import Participant
from pointit.runtime.zenoh.declarations import declare_publisher
from pointit.runtime.zenoh.wire_format import PRIORITY, encoding_of
from pointit.schemas import Message, encode
from pointit.schemas.topics import Delivery, Topic

M = TypeVar("M", bound=Message)
EVENT_CACHE = 500
"""Events a writer keeps for readers that were cut off."""
HEARTBEAT_S = 0.2
"""Period of sequence numbers published by a writer of states and events. Bounds the time to recover."""


class _LatestWriter:
    """Sends the newest, and nothing at all while nobody elsewhere reads it."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str) -> None:
        self._publisher = declare_publisher(
            session, key, encoding=encoding_of(topic.message), priority=zenoh.Priority.INTERACTIVE_HIGH
        )
        self._wanted = False  # the listener tells at once if there is somebody
        # No callback of ours here: it would wait for Python's lock on the thread that ends the heartbeats of
        # _KeptWriter, whose `undeclare` waits for that thread with the lock held, 10 s (Zenoh 1.10).
        self._listener = self._publisher.declare_matching_listener(RingChannel(1))

    def put(self, message: Message) -> None:
        matching = self._listener.try_recv()
        if matching is not None:
            self._wanted = matching.matching
        if self._wanted:
            self._publisher.put(encode(message))

    def undeclare(self) -> None:
        self._listener.undeclare()
        self._publisher.undeclare()


class _RetainedWriter:
    """Sends states and events, and keeps the last of them for readers that come late or were cut off."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str) -> None:
        # What cannot be fetched from this cache is counted by the reader.
        self._publisher = declare_publisher(
            session,
            key,
            cache=1 if topic.delivery is Delivery.STATE else EVENT_CACHE,
            missed=ext.MissDetectionConfig(heartbeat=HEARTBEAT_S, sporadic_heartbeat=None),
            encoding=encoding_of(topic.message),
            priority=PRIORITY,
        )

    def put(self, message: Message) -> None:
        self._publisher.put(encode(message))

    def undeclare(self) -> None:
        self._publisher.undeclare()


class ZenohPublisher(MemoryPublisher[M]):
    """Hands messages to this process's readers, and their bytes to Zenoh for the others."""

    def __init__(self, bus: Participant, session: zenoh.Session, topic: Topic[M], name: str) -> None:
        key = topic.at(name)
        self._writer = (
            _LatestWriter(session, topic, key)
            if topic.delivery is Delivery.LATEST
            else _RetainedWriter(session, topic, key)
        )
        self._retires = False
        super().__init__(bus, topic, name, self._writer.put)

    def close_nowait(self) -> None:
        """Write no more; elsewhere the writer is gone with the bus, or a moment later."""
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
