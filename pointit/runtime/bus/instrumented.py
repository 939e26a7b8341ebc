"""Publishers, subscriptions and servers of a service that measure each message."""

import asyncio
import bisect
import collections
import itertools
import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from pointit.runtime.bus.contract import (
    AnyTopic,
    Declaration,
    Handler,
    Publisher,
    Server,
    Subscription,
    SubscriptionStats,
)
from pointit.runtime.bus.timeliness import MAX_LEAD_NS, STREAMS, LateMessageFilter, OutOfOrderFilter
from pointit.runtime.clock import Clock
from pointit.runtime.errors import BusClosedError
from pointit.runtime.virtual_time import is_virtual
from pointit.schemas import NS_PER_S, Message, Quantiles, Query, Reply, ServedRequest
from pointit.schemas.problems import HANDLER, INVALID, LATE, MAX_SUBJECT, Problem
from pointit.schemas.system import DURATION_BOUNDS_S
from pointit.schemas.table_types import fill_key
from pointit.schemas.text import hide_secrets
from pointit.schemas.topics import Delivery, Request

log = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

REFUSED_SHOWN_S = 5.0
"""Time for which a warning about dropped messages is shown after the last of them, s."""
MAX_DURATIONS = 65_536
"""Maximum number of durations between two reports that are counted, the newest ones."""
MAX_REPLY = ServedRequest.max_bytes // 8
"""Maximum characters of a published reply. Each takes up to four bytes."""
MAX_REFUSAL = 4096


def steady_time() -> Callable[[], float]:
    """Return the clock of the running loop, s: monotonic, and virtual where a recording is replayed."""
    # the loop's own `time` is a Python function, called a dozen times a sample
    return asyncio.get_running_loop().time if is_virtual() else time.monotonic


class DurationWindow:
    """Histogram and quantiles of the durations between two reports. Used in the event loop only."""

    def __init__(self, per_s: float = 1.0) -> None:
        """Create an empty histogram. `per_s` is the number of units per second of the added durations."""
        self.per_s = per_s
        self.values: collections.deque[float] = collections.deque(maxlen=MAX_DURATIONS)
        """Durations, to which callers append."""

    def take(self) -> Quantiles | None:
        """Return quantiles and histogram of the values since the last call, or None without values."""
        if not self.values:
            return None
        ordered = sorted(self.values)
        self.values.clear()

        def quantile(share: float) -> float:  # nearest rank: one of the values, never below the share
            rank = math.ceil(share * len(ordered))
            return ordered[rank - 1] / self.per_s

        up_to = [bisect.bisect_right(ordered, bound_s * self.per_s) for bound_s in DURATION_BOUNDS_S]
        limits = [0, *up_to, len(ordered)]
        counts = tuple(end - start for start, end in itertools.pairwise(limits))
        sum_s = math.fsum(ordered) / self.per_s
        return Quantiles(p50_s=quantile(0.5), p99_s=quantile(0.99), counts=counts, sum_s=sum_s)


class _DropCounter:
    """Counts dropped messages and limits the time of the warning about them."""

    def __init__(self) -> None:
        self._count = 0
        self._grown_s = -math.inf

    def holds(self, count: int, now_s: float) -> bool:
        if count > self._count:
            self._count = count
            self._grown_s = now_s
        return now_s - self._grown_s <= REFUSED_SHOWN_S


@dataclass(slots=True, eq=False)
class ReaderCounts:
    """Counters of one reader of a topic, or their sums over all closed readers."""

    traffic: SubscriptionStats = field(default_factory=SubscriptionStats)
    order: OutOfOrderFilter = field(default_factory=OutOfOrderFilter)
    lateness: LateMessageFilter = field(default_factory=LateMessageFilter)

    def add(self, other: "ReaderCounts") -> None:
        """Add the counters of `other`."""
        for counter in ("received", "dropped", "lost", "invalid", "errors"):
            sum_of_both = getattr(self.traffic, counter) + getattr(other.traffic, counter)
            setattr(self.traffic, counter, sum_of_both)
        if other.traffic.errors:
            self.traffic.last_failure = other.traffic.last_failure
            self.traffic.last_failure_name = other.traffic.last_failure_name
        self.order.refused += other.order.refused
        self.lateness.refused += other.lateness.refused
        self.lateness.by_s = max(self.lateness.by_s, other.lateness.by_s)


@dataclass(slots=True)
class TopicTotals:
    """Sums of the counters of all readers of a topic."""

    dropped: int = 0
    lost: int = 0
    invalid: int = 0
    errors: int = 0
    out_of_order: int = 0
    late: int = 0


class TopicMeter:
    """Message counter of one topic in one direction. The message handler increments it."""

    def __init__(self, topic: AnyTopic) -> None:
        self.topic = topic
        self.count = 0
        """Messages since the last report."""
        self.newest_s: float | None = None
        """Time of the newest message, s, monotonic."""
        self._closed = ReaderCounts()
        self._readers = {self._closed}
        self._old = _DropCounter()
        self._late = _DropCounter()
        self._invalid = _DropCounter()
        self._failed = _DropCounter()

    def add(self, reader: ReaderCounts) -> None:
        """Include the counters of `reader`."""
        self._readers.add(reader)

    def close(self, reader: ReaderCounts) -> None:
        """Add the counters of the closed `reader` to the sums and release it."""
        if reader in self._readers:
            self._readers.remove(reader)
            self._closed.add(reader)

    def age_s(self, now_s: float) -> float | None:
        """Return the age of the newest message, s, or None."""
        return None if self.newest_s is None else now_s - self.newest_s

    def totals(self) -> TopicTotals:
        """Return the sums over all readers, open and closed."""
        totals = TopicTotals()
        for reader in self._readers:
            traffic = reader.traffic
            totals.dropped += traffic.dropped
            totals.lost += traffic.lost
            totals.invalid += traffic.invalid
            totals.errors += traffic.errors
            totals.out_of_order += reader.order.refused
            totals.late += reader.lateness.refused
        return totals

    def problems(self, totals: TopicTotals, now_s: float, user: str) -> list[Problem]:
        """Return one problem each for recent messages that were out of order, late, invalid or failed.

        `totals`: the sums of now. `user`: the person whose service reads the messages, or `""`.
        """
        # Each counter is read in every report, since it compares with the last reading
        has_old = self._old.holds(totals.out_of_order, now_s)
        has_invalid = self._invalid.holds(totals.invalid, now_s)
        has_failed = self._failed.holds(totals.errors, now_s)
        has_late = self._late.holds(totals.late, now_s)
        problems: list[Problem] = []
        if has_old:
            problems.append(self._disorder(totals.out_of_order, user))
        if has_invalid:
            problems += self._invalid_messages(totals.invalid, user)
        if has_failed:
            problems.append(self._failure(totals.errors, user))
        if has_late:
            problems.append(self._lateness(totals.late, user))
        return problems

    def _disorder(self, count: int, user: str) -> Problem:
        """Return the problem of `count` messages that were older than those before them."""
        key = self.topic.key
        sentence = (
            f"{count} messages on {fill_key(key, user)} were older than those before them and were left out: "
            "is a recording played on this site, or do two write the same?"
        )
        return Problem(code=LATE, sentence=sentence, topic=key)

    def _invalid_messages(self, count: int, user: str) -> list[Problem]:
        """Return the problem of `count` invalid messages. Only the senders of readable keys are known."""
        key = self.topic.key
        for reader in self._readers:
            sender = reader.traffic.last_error_name
            if sender:
                sentence = (
                    f"{count} messages on {fill_key(key, user)} were invalid and were dropped, the last of "
                    f"{sender} ({reader.traffic.last_error}): look at what writes them there"
                )
                return [Problem(code=INVALID, sentence=sentence, topic=key, subject=sender[:MAX_SUBJECT])]
        return []

    def _lateness(self, count: int, user: str) -> Problem:
        """Return the problem of `count` messages that came after newer ones."""
        key = self.topic.key
        by_s = max(reader.lateness.by_s for reader in self._readers)
        sentence = (
            f"{count} messages on {fill_key(key, user)} arrived after newer ones, the last by "
            f"{by_s:.1f} s, and were left out: check the link to their writer, which is slow or "
            "loses much"
        )
        return Problem(code=LATE, sentence=sentence, topic=key)

    def _failure(self, count: int, user: str) -> Problem:
        """Return the problem of `count` messages whose handler raised an error, with the last sender."""
        last = next(reader.traffic for reader in self._readers if reader.traffic.errors)
        sender = last.last_failure_name
        origin = f", the last of {sender}" if sender else ""
        key = fill_key(self.topic.key, user)
        sentence = (
            f"{count} messages on {key} could not be handled{origin} "
            f"({last.last_failure}): end what writes them there, and report this with the log"
        )
        return Problem(code=HANDLER, sentence=sentence, topic=self.topic.key, subject=sender[:MAX_SUBJECT])


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
        self._meter.count += 1
        self._meter.newest_s = self._time_s()
        if self._latency is not None:
            self._latency.values.append(self._now_ns() - message.stamp_ns)

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
    is_ordered = in_order and meter.topic in STREAMS
    order = counts.order if is_ordered else None
    newest_by_name = counts.order.newest
    is_in_time = counts.lateness.accepts
    time_s = steady_time()
    now_ns = clock.now_ns
    durations_s = steps.values

    def filter_and_time(message: M, name: str) -> None:
        began_s = time_s()
        stamp_ns = message.stamp_ns
        if order is not None:
            newest = newest_by_name.get(name)
            if newest is not None and 0 <= stamp_ns - newest.stamp_ns <= MAX_LEAD_NS:  # no call
                newest.stamp_ns = stamp_ns
                newest.came_s = began_s
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
            received_ns = self._clock.now_ns()
            try:
                reply = await server(query, name)
            except Exception as error:
                refusal = hide_secrets(str(error)) or type(error).__name__
                self._publish_request(received_ns, request.at(name), query, None, refusal)
                raise
            self._publish_request(received_ns, request.at(name), query, reply, "")
            return reply

        return answer

    def _publish_request(
        self, received_ns: int, key: str, query: Query, reply: Reply | None, refusal: str
    ) -> None:
        """Publish the request. Errors are only logged, since the request itself was answered."""
        self._seq += 1
        try:
            text = "" if reply is None else reply.model_dump_json()
            if len(text) > MAX_REPLY:
                log.warning("the reply to %s is too large to be recorded: %d characters", key, len(text))
                text = ""
            served = ServedRequest(
                stamp_ns=received_ns,
                seq=self._seq,
                service=self._service,
                instance=self._instance,
                request=key,
                query=query.model_dump_json(),
                reply=text,
                refusal=refusal[:MAX_REFUSAL],
            )
            self._publisher.put(served)
        except BusClosedError:
            # the caller is answered all the same; a closed service has no recorder either
            pass
        except Exception:
            log.exception("a request to %s is answered, but not published for recordings", key)
