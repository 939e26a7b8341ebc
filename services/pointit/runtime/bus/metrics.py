"""Message counts and durations between two reports of a service, measured at its bus."""

import asyncio
import bisect
import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from pointit.runtime.bus.contract import AnyTopic, SubscriptionStats
from pointit.runtime.bus.timeliness import LateMessageFilter, OutOfOrderFilter
from pointit.runtime.clock import Clock
from pointit.runtime.virtual_time import is_virtual
from pointit.schemas import NS_PER_S, Quantiles
from pointit.schemas.system import DURATION_BOUNDS_S

REFUSED_SHOWN_S = 5.0
"""Time for which a warning about dropped messages is shown after the last of them, s."""
SAMPLES = 4096
"""Minimum number of the newest durations from which quantiles are computed, or all if fewer."""
FULL = 2 * SAMPLES
"""Number of durations from which older ones only count in the histogram."""


def steady_time() -> Callable[[], float]:
    """Return the clock of the running loop, s: monotonic, and virtual where a recording is replayed."""
    # the loop's own `time` is a Python function, called a dozen times a sample
    return asyncio.get_running_loop().time if is_virtual() else time.monotonic


class DurationWindow:
    """Histogram and quantiles of the durations between two reports. Used in the event loop only."""

    def __init__(self, per_s: float = 1.0) -> None:
        """Create an empty histogram. `per_s` is the number of units per second of the added durations."""
        self.per_s = per_s
        self.values: list[float] = []
        """Newest durations. Callers that append without `add`, to save its call, `fold` them if `FULL`."""
        self._counts = [0] * (len(DURATION_BOUNDS_S) + 1)
        """Number of older durations in each bucket."""
        self._sum_s = 0.0
        """Sum of the older durations."""

    def add(self, duration: float) -> None:
        """Add a duration."""
        self.values.append(duration)
        if len(self.values) >= FULL:
            self.fold()

    def fold(self) -> None:
        """Move all but the newest `SAMPLES` durations into the buckets."""
        # many are sorted into their buckets at once: 0.06 us each, 0.15 us beyond 8192; one at a time 0.2 us
        self._count(sorted(self.values[:-SAMPLES]))
        del self.values[:-SAMPLES]

    def _count(self, ordered: list[float]) -> None:
        bounds = (bound_s * self.per_s for bound_s in DURATION_BOUNDS_S)
        up_to = [*(bisect.bisect_right(ordered, bound) for bound in bounds), len(ordered)]
        for index, (before, after) in enumerate(itertools.pairwise([0, *up_to])):
            self._counts[index] += after - before
        self._sum_s += math.fsum(ordered) / self.per_s

    def take(self) -> Quantiles | None:
        """Return quantiles and histogram of the values since the last call, or None without values."""
        if not self.values:
            return None
        ordered = sorted(self.values)
        self._count(ordered)

        def quantile(share: float) -> float:  # nearest rank: one of the values, never below the share
            return ordered[math.ceil(share * len(ordered)) - 1] / self.per_s

        p50_s, p99_s = quantile(0.5), quantile(0.99)
        taken = Quantiles(p50_s=p50_s, p99_s=p99_s, counts=tuple(self._counts), sum_s=self._sum_s)
        self.values.clear()
        self._counts = [0] * len(self._counts)
        self._sum_s = 0.0
        return taken


class _DropCounter:
    """Counts dropped messages and limits the time of the warning about them."""

    def __init__(self) -> None:
        self._count = 0
        self._grown_s = -math.inf

    def holds(self, count: int, now_s: float) -> bool:
        if count > self._count:
            self._count, self._grown_s = count, now_s
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
        self.order.refused += other.order.refused
        self.lateness.refused += other.lateness.refused
        self.lateness.by_s = max(self.lateness.by_s, other.lateness.by_s)


class TopicMeter:
    """Message counter of one topic in one direction. The message handler increments it."""

    def __init__(self, topic: AnyTopic) -> None:
        self.topic = topic
        self.count = 0
        """Messages since the last report."""
        self.newest_s: float | None = None
        """Time of the newest message, s, monotonic."""
        self.newest_ns = 0
        """Its time by the service's clock if no other clock was read since the last report, else 0."""
        self._closed = ReaderCounts()
        self._readers = {self._closed}
        self._old = _DropCounter()
        self._late = _DropCounter()
        self._invalid = _DropCounter()

    def add(self, reader: ReaderCounts) -> None:
        """Include the counters of `reader`."""
        self._readers.add(reader)

    def close(self, reader: ReaderCounts) -> None:
        """Add the counters of the closed `reader` to the sums and release it."""
        if reader in self._readers:
            self._readers.remove(reader)
            self._closed.add(reader)

    def age_s(self, now_s: float, span_s: float, clock: Clock) -> float | None:
        """Return the age of the newest message, s, or None. `span_s`: time since the last report."""
        if self.newest_ns:  # the clock may have been set meanwhile
            passed_s = (clock.now_ns() - self.newest_ns) / NS_PER_S / clock.speed
            self.newest_s = now_s - min(max(0.0, passed_s), span_s)
            self.newest_ns = 0
        return None if self.newest_s is None else now_s - self.newest_s

    def total(self, counter: str) -> int:
        """Return the sum of one of the counters of `SubscriptionStats` over all readers."""
        return sum(getattr(reader.traffic, counter) for reader in self._readers)

    def warnings(self, now_s: float) -> Iterator[str]:
        """Yield one warning each for recent messages that were out of order, late or invalid."""
        old = sum(reader.order.refused for reader in self._readers)
        if self._old.holds(old, now_s):
            yield (
                f"{old} messages on {self.topic.key} were older than those before them and were left out: "
                "is a recording played on this site, or do two write the same?"
            )
        invalid = self.total("invalid")
        if self._invalid.holds(invalid, now_s):
            bad = next((each.traffic for each in self._readers if each.traffic.last_error_name), None)
            if bad is not None:
                yield (
                    f"{invalid} messages on {self.topic.key} were invalid and were dropped, the last of "
                    f"{bad.last_error_name} ({bad.last_error}): look at what writes them there"
                )
        late = sum(reader.lateness.refused for reader in self._readers)
        if self._late.holds(late, now_s):
            by_s = max(reader.lateness.by_s for reader in self._readers)
            yield (
                f"{late} messages on {self.topic.key} came later than others before them, the last by "
                f"{by_s:.1f} s, and were left out: check the link to their writer, which is slow or "
                "loses much"
            )
