"""Publishers and subscriptions of ROS topics on Zenoh."""

import collections
from collections.abc import Callable

import xxhash

from pointit.bridges.ros2.graph.backend import Closable, Qos, RosType, check_cdr
from pointit.bridges.ros2.graph.node_backend import MessageQueue, RosEndpoint
from pointit.bridges.ros2.over_zenoh.attachment import packed, unpacked
from pointit.bridges.ros2.over_zenoh.endpoint_context import EndpointContext
from pointit.runtime.foreign_zenoh.pubsub import RawSample

REMEMBERED = 16
"""Minimum number of a topic's messages that are remembered to drop duplicates."""


class ZenohWriter(RosEndpoint[EndpointContext]):
    """Publisher of one topic."""

    def __init__(self, context: EndpointContext, topic: str, kind: RosType, qos: Qos) -> None:
        """Declare. The presence token comes last: peers that see it find a publisher."""
        super().__init__(context, topic)
        # Zenoh's caches do not expire: with a lifespan nothing is cached, rather than everything for ever.
        # Subscribers of a latched topic still receive later messages.
        self._writer = context.session.publisher(
            context.rmw.key(topic, kind), cache_size=qos.depth if qos.lasts else 0, reliable=qos.reliable
        )
        self._token = context.announce("publisher", topic, kind, qos)
        context.ends.add(self)

    @property
    def is_read(self) -> bool:
        """Return True if Zenoh knows a subscriber, with or without a token; False for a latched topic."""
        return not self._context.is_closed and self._writer.is_read

    def put(self, cdr: bytes) -> None:
        """Send; returns at once, and never blocks on readers.

        Raises:
            ValueError: If `cdr` is not CDR.
            BusClosedError: If this writer or its backend is closed.
        """
        check_cdr(cdr)
        self._writer.put(cdr, packed(self._token.next()))

    def _undeclare(self) -> None:
        self._token.close()
        self._writer.close()


class ZenohReader(RosEndpoint[EndpointContext]):
    """Subscription of one topic, without messages of ourselves and of other PointIt bridges."""

    def __init__(
        self, context: EndpointContext, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]
    ) -> None:
        """Declare; `handler` gets the CDR of messages."""
        super().__init__(context, topic)
        self.has_heard = False
        """Messages have come since this was last set to False."""
        self._kind = kind
        self._handler = handler
        self._malformed = 0
        self._has_arrived = False
        self._recent: collections.OrderedDict[bytes, None] = collections.OrderedDict()
        self._remembered = max(qos.depth, REMEMBERED)
        # Receives misrouted messages of this topic; undeclared after the first message, good or not.
        self._misrouted = self._subscribed(context.rmw.misrouted_keys(topic), self._on_misrouted, None)
        self._reader = self._subscribed(context.rmw.key(topic, kind), self._on_sample, qos)
        self._token = context.announce("subscriber", topic, kind, qos)
        context.ends.add(self)

    def _subscribed(
        self, key: str, handler: Callable[[RawSample], None], qos: Qos | None
    ) -> tuple[Closable, ...]:
        """Return a subscriber and its queue."""
        context = self._context
        queue = MessageQueue(context, self.name, handler, qos)
        subscriber = context.session.subscriber(
            key,
            lambda sample: queue.put(sample, is_oversized=sample.is_oversized(context.max_bytes)),
            cache_size=qos.depth if qos and qos.latched else 0,
            reliable=qos is not None and qos.reliable,
        )
        return subscriber, queue

    def _undeclare(self) -> None:
        for each in (self._token, *self._reader):
            each.close()
        self._end_misrouted()

    def _on_sample(self, sample: RawSample) -> None:
        try:
            origin = unpacked(sample.attachment)
        except ValueError as error:
            self._malformed += 1
            self._context.warnings.show_briefly(
                f"attachments of {self.name}", f"dropped {self._malformed} messages on {self.name}: {error}"
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

    def _on_misrouted(self, sample: RawSample) -> None:
        why = self._context.rmw.misrouting_reason(sample.key, self.name, self._kind)
        if why and not self._is_of_bridge(sample):
            self._context.warnings.show(f"stray {self.name}", why)
            self._close_misrouted()  # one is enough: another robot may publish many

    def _is_of_bridge(self, sample: RawSample) -> bool:
        """Return True if it is from another PointIt, where misrouting is intended."""
        try:
            return self._context.is_own_gid(unpacked(sample.attachment).gid)
        except ValueError:
            return False

    def _end_misrouted(self) -> None:
        self._close_misrouted()
        self._context.warnings.clear(f"stray {self.name}")

    def _close_misrouted(self) -> None:
        for each in self._misrouted:
            each.close()
        self._misrouted = ()
