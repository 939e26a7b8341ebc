"""Publishers, subscriptions and servers of a service that measure or publish each message."""

import logging
from collections.abc import Callable
from typing import Generic, TypeVar

from pointit.runtime.bus.contract import (
    Declaration,
    Handler,
    Publisher,
    Server,
    Subscription,
    SubscriptionStats,
)
from pointit.runtime.bus.metrics import FULL, DurationWindow, ReaderCounts, TopicMeter, steady_time
from pointit.runtime.bus.timeliness import MAX_LEAD_NS, STREAMS
from pointit.runtime.clock import Clock
from pointit.runtime.errors import BusClosedError
from pointit.schemas import NS_PER_S, Message, Query, Reply, ServedRequest
from pointit.schemas.text import hide_secrets
from pointit.schemas.topics import Delivery, Request

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)
MAX_REPLY = ServedRequest.max_bytes // 8
"""Maximum characters of a published reply. Each takes up to four bytes."""
MAX_REFUSAL = 4096

log = logging.getLogger(__name__)


class InstrumentedPublisher(Generic[M]):
    """Counts published messages. For *latest*, it also measures the age of the captured data."""

    def __init__(
        self, inner: Publisher[M], meter: TopicMeter, latency: DurationWindow | None, clock: Clock
    ) -> None:
        self._inner = inner
        self._meter = meter
        self._latency = latency if meter.topic.delivery is Delivery.LATEST else None
        self._now_ns = clock.now_ns
        self._time_s = steady_time()

    def put(self, message: M) -> None:
        """Send `message`."""
        self._inner.put(message)
        meter = self._meter
        meter.count += 1
        if self._latency is None:
            meter.newest_s = self._time_s()
        else:  # one clock reading for both
            meter.newest_ns = now_ns = self._now_ns()
            ages_ns = self._latency.values
            ages_ns.append(now_ns - message.stamp_ns)
            if len(ages_ns) >= FULL:
                self._latency.fold()

    def close(self) -> None:
        """Undeclare."""
        self._inner.close()

    def close_nowait(self) -> None:
        """Close together with many others."""
        self._inner.close_nowait()


def instrument_handler(
    handler: Handler[M],
    meter: TopicMeter,
    steps: DurationWindow,
    clock: Clock,
    drops_late: Callable[[M], object] | None,
    *,
    counts: ReaderCounts,
    in_order: bool = True,
) -> Handler[M]:
    """Return `handler` behind a subscriber's filters, which counts messages and times calls (s).

    `drops_late` returns True for a message that is dropped if it is late. None accepts all. `in_order` drops
    messages of a stream that are older than its newest one.
    """
    order = counts.order if in_order and meter.topic in STREAMS else None
    newest_by_name = counts.order.newest
    is_in_time = counts.lateness.accepts
    time_s, now_ns = steady_time(), clock.now_ns
    durations_s = steps.values

    def filter_and_time(message: M, name: str) -> None:
        began_s, stamp_ns = time_s(), message.stamp_ns
        if order is not None:
            newest = newest_by_name.get(name)
            if newest is not None and 0 <= stamp_ns - newest.stamp_ns <= MAX_LEAD_NS:  # no call
                newest.stamp_ns, newest.came_s = stamp_ns, began_s
            elif not order.accepts(name, stamp_ns, began_s):
                return
        if drops_late is not None and drops_late(message):
            # wall-clock seconds; where time runs slowly, the loop's own, since such a clock is coarse
            age_s = (now_ns() - stamp_ns) / NS_PER_S
            speed = clock.speed
            if speed > 1.0:
                age_s /= speed
            if not is_in_time(name, age_s, began_s):
                return
        meter.count += 1
        meter.newest_s = began_s
        handler(message, name)
        durations_s.append(time_s() - began_s)
        if len(durations_s) >= FULL:
            steps.fold()

    return filter_and_time


class MeteredSubscription(Declaration):
    """A subscription. Its meter keeps the counters after it is closed."""

    def __init__(
        self, inner: Subscription, held: dict[Declaration, None], meter: TopicMeter, counts: ReaderCounts
    ) -> None:
        super().__init__(inner.close, held)
        self._meter = meter
        self._counts = counts
        counts.traffic = inner.traffic
        meter.add(counts)

    @property
    def traffic(self) -> SubscriptionStats:
        """Return the live counters."""
        return self._counts.traffic

    def active_names(self, within_s: float) -> set[str]:
        """Return the names of a stream (one of `STREAMS`) with a message in the last `within_s` seconds."""
        return self._counts.order.active_names(steady_time()() - within_s)

    def close(self) -> None:
        """Undeclare."""
        super().close()
        self._meter.close(self._counts)


class ServedPublisher:
    """Publishes each request of one service after its answer."""

    def __init__(
        self, publisher: Publisher[ServedRequest], clock: Clock, *, service: str, instance: str
    ) -> None:
        self._publisher = publisher
        self._clock = clock
        self._service = service
        self._instance = instance
        self._seq = 0

    def reporting(self, request: Request[Q, R], server: Server[Q, R]) -> Server[Q, R]:
        """Return `server` with a wrapper that publishes queries, replies and refusals."""

        async def answer(query: Q, name: str) -> R:
            asked_ns = self._clock.now_ns()
            try:
                reply = await server(query, name)
            except Exception as error:
                self._put(
                    asked_ns, request.at(name), query, None, hide_secrets(str(error)) or type(error).__name__
                )
                raise
            self._put(asked_ns, request.at(name), query, reply, "")
            return reply

        return answer

    def _put(self, asked_ns: int, key: str, query: Query, reply: Reply | None, refusal: str) -> None:
        """Publish the request. Errors are only logged, since the request itself was answered."""
        self._seq += 1
        try:
            text = "" if reply is None else reply.model_dump_json()
            if len(text) > MAX_REPLY:
                log.warning("the reply to %s is too large to be recorded: %d characters", key, len(text))
                text = ""
            self._publisher.put(
                ServedRequest(
                    stamp_ns=asked_ns,
                    seq=self._seq,
                    service=self._service,
                    instance=self._instance,
                    request=key,
                    query=query.model_dump_json(),
                    reply=text,
                    refusal=refusal[:MAX_REFUSAL],
                )
            )
        except BusClosedError:
            pass
        except Exception:
            log.exception("a request to %s is answered, but not published for recordings", key)
