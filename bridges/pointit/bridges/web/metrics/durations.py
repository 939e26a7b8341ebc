"""Histograms of durations that services report as quantiles of each second; pure."""

from bisect import bisect_left
from collections import defaultdict
from itertools import accumulate

from prometheus_client.metrics_core import HistogramMetricFamily

from pointit.schemas import Quantiles

BOUNDS_S = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Upper bounds of the buckets, s. 50 ms is the limit of `pointit load` from wrist to light."""

STATISTICS = ("p50", "p99")


class Durations:
    """Counts, by service, the seconds whose median and 99th percentile fell into each bucket."""

    def __init__(self) -> None:
        """Begin with none."""
        self._counts: dict[tuple[str, str], list[int]] = {}
        self._sums_s: defaultdict[tuple[str, str], float] = defaultdict(float)

    def add(self, service: str, quantiles: Quantiles | None) -> None:
        """Count the quantiles of one report. None adds nothing."""
        if quantiles is None:
            return
        for statistic, value_s in zip(STATISTICS, (quantiles.p50_s, quantiles.p99_s), strict=True):
            key = service, statistic
            counts = self._counts.setdefault(key, [0] * (len(BOUNDS_S) + 1))
            counts[bisect_left(BOUNDS_S, value_s)] += 1
            self._sums_s[key] += max(0.0, value_s)  # a clock that was set back must not lower the sum

    def family(self, name: str, about: str) -> HistogramMetricFamily:
        """Return the histogram under `name`, with its help."""
        family = HistogramMetricFamily(name, about, labels=("service", "statistic"))
        bounds = [*map(str, BOUNDS_S), "+Inf"]
        for key, counts in self._counts.items():
            buckets = list(zip(bounds, map(float, accumulate(counts)), strict=True))
            family.add_metric(key, buckets, self._sums_s[key])
        return family
