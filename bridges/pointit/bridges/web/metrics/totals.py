"""Totals that only grow and histograms of durations, from counters that start again with a service; pure."""

from collections import Counter, OrderedDict, defaultdict
from collections.abc import Iterable, Iterator
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

from pointit.schemas import Health, KeyHealth, Quantiles
from pointit.schemas.system import DURATION_BOUNDS_S
from pointit.schemas.topics import TOPICS

if TYPE_CHECKING:
    from prometheus_client.metrics_core import HistogramMetricFamily

MAX_INSTANCES = 4096
"""Maximum number of instances whose last report is stored; the oldest is dropped."""

MAX_TOPICS = 64
"""Maximum number of topics in a report that are counted."""

OTHER = "other"
"""Label for keys that are no row of the topic table, and unknown services; bounds the number of series."""

KNOWN_KEYS = frozenset(topic.key for topic in TOPICS)

BUCKETS = (*map(str, DURATION_BOUNDS_S), "+Inf")


class Labels(NamedTuple):
    """Labels of one total. Those that a counter does not have are `""`."""

    counter: str
    """`messages`, `discarded`, `errors` or `refused`."""
    service: str
    topic: str = ""
    kind: str = ""
    """Direction of messages, or the reason why they were discarded."""


class Totals:
    """Sums the counters of services over their instances and restarts."""

    def __init__(self) -> None:
        self.values: defaultdict[Labels, float] = defaultdict(float)
        self._last: OrderedDict[str, tuple[Health, dict[Labels, float]]] = OrderedDict()

    def add(self, instance: str, service: str, health: Health) -> None:
        """Add what `instance` has counted since its last report.

        What it counted before its first report here is not added, nor is a report that comes late.
        """
        keys = _keys(health)
        counts = dict(_counts(service, health, keys))
        before, counts_before = self._last.pop(instance, (None, dict[Labels, float]()))
        since_s = 0.0
        """Uptime at which the rates of this report begin."""
        if before is None:
            if health.seq != 1:  # it runs for longer than anybody listens here
                since_s, counts_before = health.uptime_s, counts
        elif (health.uptime_s, health.seq) > (before.uptime_s, before.seq):
            since_s = before.uptime_s
        elif health.stamp_ns <= before.stamp_ns:
            self._last[instance] = (before, counts_before)
            return
        else:
            counts_before = {}  # restarted
        for labels, count in counts.items():
            # a counter below its last value has started again
            last = counts_before.get(labels, 0.0)
            self.values[labels] += count - last if count >= last else count
        for key in keys:
            labels = Labels("messages", service, key.key, key.direction)
            self.values[labels] += round(key.rate_hz * (health.uptime_s - since_s))
        self._last[instance] = (health, counts)
        if len(self._last) > MAX_INSTANCES:
            self._last.popitem(last=False)


def _keys(health: Health) -> list[KeyHealth]:
    return [
        key if key.key in KNOWN_KEYS else key.model_copy(update={"key": OTHER})
        for key in health.keys[:MAX_TOPICS]
    ]


def _counts(service: str, health: Health, keys: Iterable[KeyHealth]) -> Iterator[tuple[Labels, float]]:
    yield Labels("errors", service), health.errors
    discarded: Counter[Labels] = Counter()
    for key in keys:
        if key.direction == "in":
            for reason, count in (("dropped", key.dropped), ("lost", key.lost), ("invalid", key.invalid)):
                discarded[Labels("discarded", service, key.key, reason)] += count
    yield from discarded.items()
    for figure in health.figures:
        if figure.name == "refused":
            yield Labels("refused", service), max(0.0, figure.value)


class Durations:
    """Counts durations, by service."""

    def __init__(self) -> None:
        self._counts: dict[str, list[int]] = {}
        self._sums_s: defaultdict[str, float] = defaultdict(float)

    def add(self, service: str, reported: Quantiles | None) -> None:
        """Count the durations of one report. None, or one that has no counts, adds nothing."""
        if reported is None or len(reported.counts) != len(BUCKETS):
            return
        counts = self._counts.get(service, [0] * len(BUCKETS))
        self._counts[service] = [sum(pair) for pair in zip(counts, reported.counts, strict=True)]
        self._sums_s[service] += max(0.0, reported.sum_s)  # a clock that was set back must not lower the sum

    def family(self, name: str, about: str) -> "HistogramMetricFamily":
        """Return the histogram under `name`, with its help."""
        from prometheus_client.metrics_core import HistogramMetricFamily  # noqa: PLC0415 - see SiteMetrics

        family = HistogramMetricFamily(name, about, labels=("service",))
        for service, counts in self._counts.items():
            buckets = list(zip(BUCKETS, map(float, accumulate(counts)), strict=True))
            family.add_metric((service,), buckets, self._sums_s[service])
        return family
