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

    def __init__(self, context: EndpointContext, topic: str, kind: RosType, qos: Qos) -> None:
        """Declare. The presence token comes last: peers that see it find a publisher."""
        token = context.rmw.endpoint_token("publisher", topic, kind, qos)
        self.topic = topic
        self._context = context
        # Zenoh's caches do not expire: with a lifespan nothing is cached, rather than everything for ever.
        # Subscribers of a latched topic still receive later messages.
        self._writer = context.session.publisher(
            context.rmw.key(topic, kind), kept=qos.depth if qos.lasts else 0, reliable=qos.reliable
        )
        self._sender = SequenceCounter(context, token)
        self._token = context.announce(token)
        context.ends.add(self)

    @property
    def is_read(self) -> bool:
        """Return True if Zenoh knows a subscriber, with or without a token; False for a latched topic."""
        return not self._context.session.is_closed and self._writer.is_read

    def put(self, cdr: bytes) -> None:
        """Send; returns at once, and never blocks on readers.

        Raises:
            ValueError: If `cdr` is not CDR.
            BusClosedError: If this writer or its backend is closed.
        """
        check_cdr(cdr)
        self._writer.put(cdr, self._context.rmw.pack(self._sender.next()))

    def close(self) -> None:
        """Stop publishing."""
        if not self._context.session.is_closed:
            self._token.close()
            self._writer.close()
        self._sender.close()
        self._context.ends.discard(self)


class TopicReader:
    """Subscription of one topic, without messages of ourselves and of other PointIt bridges."""

    def __init__(
        self, context: EndpointContext, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]
    ) -> None:
        """Declare; `handler` gets the CDR of messages."""
        self.topic = topic
        self.has_heard = False
        """Messages have come since this was last set to False."""
        self._context = context
        self._kind = kind
        self._handler = handler
        self._malformed = 0
        self._has_arrived = False
        self._recent: collections.OrderedDict[bytes, None] = collections.OrderedDict()
        self._remembered = max(qos.depth, REMEMBERED)
        rmw, session = context.rmw, context.session
        # Receives misrouted messages of this topic; undeclared after the first message, good or not.
        self._misrouted: RawSubscriber | None = session.subscriber(
            rmw.misrouted_keys(topic), self._on_misrouted, capacity=1, max_bytes=context.max_bytes
        )
        self._reader = session.subscriber(
            rmw.key(topic, kind),
            self._on_sample,
            on_loss=self._on_loss,
            capacity=max(qos.depth, MIN_CAPACITY),
            max_bytes=context.max_bytes,
            kept=qos.depth if qos.latched else 0,
            reliable=qos.reliable,
        )
        self._token = context.announce(rmw.endpoint_token("subscriber", topic, kind, qos))
        context.ends.add(self)

    def close(self) -> None:
        """Stop receiving."""
        if not self._context.session.is_closed:
            self._token.close()
            self._reader.close()
            self._end_misrouted()
        self._context.ends.discard(self)

    def _on_sample(self, sample: RawSample) -> None:
        try:
            origin = self._context.rmw.unpack(sample.attachment)
        except ValueError as error:
            self._malformed += 1
            self._context.warnings.show_briefly(
                f"attachments of {self.topic}", f"dropped {self._malformed} messages on {self.topic}: {error}"
            )
            return
        if self._context.is_own_gid(origin.gid):
            return
        if sample.attachment is not None and self._is_known(sample.attachment, sample.payload):
            return
        self.has_heard = True
        if not self._has_arrived:
            self._has_arrived = True
            self._end_misrouted()
        self._handler(sample.payload)

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
        context = self._context
        context.warnings.show_losses(self.topic, traffic.oversized, traffic.overrun, context.max_bytes)

    def _on_misrouted(self, sample: RawSample) -> None:
        why = self._context.rmw.misrouting_reason(sample.key, self.topic, self._kind)
        if why and not self._is_of_bridge(sample):
            self._context.warnings.show(f"stray {self.topic}", why)
            self._close_misrouted()  # one is enough: another robot may publish many

    def _is_of_bridge(self, sample: RawSample) -> bool:
        """Return True if it is from another PointIt, where misrouting is intended."""
        try:
            origin = self._context.rmw.unpack(sample.attachment)
        except ValueError:
            return False
        return self._context.is_own_gid(origin.gid)

    def _end_misrouted(self) -> None:
        self._close_misrouted()
        self._context.warnings.clear(f"stray {self.topic}")

    def _close_misrouted(self) -> None:
        if self._misrouted is not None:
            self._misrouted.close()
            self._misrouted = None
