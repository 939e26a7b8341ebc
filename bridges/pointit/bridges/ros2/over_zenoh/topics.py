"""Publishers and subscriptions of ROS topics on Zenoh."""

import collections
from collections.abc import Callable

import xxhash

from pointit.bridges.ros2.graph.backend import Qos, RosType, check_cdr
from pointit.bridges.ros2.over_zenoh.endpoint_context import EndpointContext, SequenceCounter
from pointit.runtime.foreign_zenoh.pubsub import PlainTraffic, RawSample, RawSubscriber

MIN_CAPACITY = 64
"""Minimum number of messages queued for the loop, even if a topic's QoS keeps fewer."""
REMEMBERED = 16
"""Minimum number of a topic's messages that are remembered to drop duplicates."""


class TopicWriter:
    """Publisher of one topic."""

    def __init__(self, seat: EndpointContext, topic: str, kind: RosType, qos: Qos) -> None:
        """Declare. The presence token comes last: peers that see it find a publisher."""
        token = seat.dialect.endpoint_token("publisher", topic, kind, qos)
        self.topic = topic
        self._seat = seat
        # Zenoh's caches do not expire: with a lifespan nothing is cached, rather than everything for ever.
        # Subscribers of a latched topic still receive later messages.
        self._writer = seat.session.publisher(
            seat.dialect.key(topic, kind), kept=qos.depth if qos.lasts else 0, reliable=qos.reliable
        )
        self._sender = SequenceCounter(seat, token)
        self._token = seat.announce(token)
        seat.ends.add(self)

    @property
    def is_read(self) -> bool:
        """Return True if Zenoh knows a subscriber, with or without a token; False for a latched topic."""
        return not self._seat.session.is_closed and self._writer.is_read

    def put(self, cdr: bytes) -> None:
        """Send; returns at once, and never blocks on readers.

        Raises:
            ValueError: If `cdr` is not CDR.
            BusClosedError: If this writer or its backend is closed.
        """
        check_cdr(cdr)
        self._writer.put(cdr, self._seat.dialect.pack(self._sender.next()))

    def close(self) -> None:
        """Stop publishing."""
        if not self._seat.session.is_closed:
            self._token.close()
            self._writer.close()
        self._sender.close()
        self._seat.ends.discard(self)


class TopicReader:
    """Subscription of one topic, without messages of ourselves and of other PointIt bridges."""

    def __init__(
        self, seat: EndpointContext, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]
    ) -> None:
        """Declare; `handler` gets the CDR of messages."""
        self.topic = topic
        self.has_heard = False
        """Messages have come since this was last set to False."""
        self._seat = seat
        self._kind = kind
        self._handler = handler
        self._malformed = 0
        self._has_arrived = False
        self._recent: collections.OrderedDict[bytes, None] = collections.OrderedDict()
        self._remembered = max(qos.depth, REMEMBERED)
        dialect, session = seat.dialect, seat.session
        # Receives misrouted messages of this topic; undeclared after the first message, good or not.
        self._strays: RawSubscriber | None = session.subscriber(
            dialect.misrouted_keys(topic), self._on_stray, capacity=1, max_bytes=seat.max_bytes
        )
        self._reader = session.subscriber(
            dialect.key(topic, kind),
            self._on_packet,
            on_loss=self._on_loss,
            capacity=max(qos.depth, MIN_CAPACITY),
            max_bytes=seat.max_bytes,
            kept=qos.depth if qos.latched else 0,
            reliable=qos.reliable,
        )
        self._token = seat.announce(dialect.endpoint_token("subscriber", topic, kind, qos))
        seat.ends.add(self)

    def close(self) -> None:
        """Stop receiving."""
        if not self._seat.session.is_closed:
            self._token.close()
            self._reader.close()
            self._end_strays()
        self._seat.ends.discard(self)

    def _on_packet(self, packet: RawSample) -> None:
        try:
            origin = self._seat.dialect.unpack(packet.attachment)
        except ValueError as error:
            self._malformed += 1
            self._seat.warnings.show_briefly(
                f"attachments of {self.topic}", f"dropped {self._malformed} messages on {self.topic}: {error}"
            )
            return
        if self._seat.is_own_gid(origin.gid):
            return
        if packet.attachment is not None and self._is_known(packet.attachment, packet.payload):
            return
        self.has_heard = True
        if not self._has_arrived:
            self._has_arrived = True
            self._end_strays()
        self._handler(packet.payload)

    def _is_known(self, attachment: bytes, payload: bytes) -> bool:
        """Return True if this message was received before, as when it is fetched again from a cache."""
        mark = attachment + xxhash.xxh3_128_digest(payload)  # not all of it: it may be a megabyte
        if mark in self._recent:
            return True
        self._recent[mark] = None
        if len(self._recent) > self._remembered:
            self._recent.popitem(last=False)
        return False

    def _on_loss(self, traffic: PlainTraffic) -> None:
        seat = self._seat
        seat.warnings.show_losses(self.topic, traffic.oversized, traffic.overrun, seat.max_bytes)

    def _on_stray(self, packet: RawSample) -> None:
        why = self._seat.dialect.misrouting_reason(packet.key, self.topic, self._kind)
        if why and not self._is_of_bridge(packet):
            self._seat.warnings.show(f"stray {self.topic}", why)
            self._close_strays()  # one is enough: another robot may publish many

    def _is_of_bridge(self, packet: RawSample) -> bool:
        """Return True if it is from another PointIt, where misrouting is intended."""
        try:
            origin = self._seat.dialect.unpack(packet.attachment)
        except ValueError:
            return False
        return self._seat.is_own_gid(origin.gid)

    def _end_strays(self) -> None:
        self._close_strays()
        self._seat.warnings.clear(f"stray {self.topic}")

    def _close_strays(self) -> None:
        if self._strays is not None:
            self._strays.close()
            self._strays = None
