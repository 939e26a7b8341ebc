"""Histograms of durations, summed over the services of a kind and their reports; pure."""

from collections import defaultdict
from itertools import accumulate

from prometheus_client.metrics_core import HistogramMetricFamily

from pointit.schemas import Quantiles
from pointit.schemas.system import DURATION_BOUNDS_S

BUCKETS = (*map(str, DURATION_BOUNDS_S), "+Inf")


class Durations:
    """Counts durations, by service."""

    def __init__(self) -> None:
        """Begin with none."""
        self._counts: dict[str, list[int]] = {}
        self._sums_s: defaultdict[str, float] = defaultdict(float)

    def add(self, service: str, reported: Quantiles | None) -> None:
        """Count the durations of one report. None, or one that has no counts, adds nothing."""
        if reported is None or len(reported.counts) != len(BUCKETS):
            return
        counts = self._counts.get(service, [0] * len(BUCKETS))
        self._counts[service] = [sum(pair) for pair in zip(counts, reported.counts, strict=True)]
        self._sums_s[service] += max(0.0, reported.sum_s)  # a clock that was set back must not lower the sum

    def family(self, name: str, about: str) -> HistogramMetricFamily:
        """Return the histogram under `name`, with its help."""
        family = HistogramMetricFamily(name, about, labels=("service",))
        for service, counts in self._counts.items():
            buckets = list(zip(BUCKETS, map(float, accumulate(counts)), strict=True))
            family.add_metric((service,), buckets, self._sums_s[service])
        return family
