"""Paths of one person's samples from capture to light: messages with the same capture time, joined. Pure."""

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pointit.schemas import NS_PER_S

CAPTURE = "capture"
LIGHT = "light"

CAUSES: Mapping[str, str] = {
    "imu": CAPTURE,
    "ray": "imu",
    "cursor": "ray",
    "hover": "cursor",
    "frame": "cursor",
    LIGHT: "frame",
}
"""All hops in order, with the hop that causes each."""

SHARED = frozenset(("frame", LIGHT))
"""Hops that messages about other people reach, too. They begin no sample."""

SETTLE_S = 0.5
"""Time from the first message of a sample until it is judged, s. Later messages of it count as lost."""

MAX_OPEN = 4096
"""Maximum number of samples that wait, and of those that are remembered as judged."""


@dataclass(slots=True)
class SamplePath:
    """One sample: when and by which process it was published at each hop."""

    stamp_ns: int
    """Time of capture, by which its messages are found."""
    at_ns: dict[str, int]
    """Time of publication by hop, and of `CAPTURE`; wall time, Unix ns."""
    first_s: float = 0.0
    """Arrival of its first message, s (monotonic)."""
    processes: dict[str, str] = field(default_factory=dict[str, str])

    def delta_s(self, hop: str) -> float | None:
        """Return the time since the hop before, s, or None if either was not seen."""
        return self._span_s(CAUSES[hop], hop)

    def total_s(self, hop: str) -> float | None:
        """Return the time since capture, s, or None if the hop was not seen."""
        return self._span_s(CAPTURE, hop)

    def _span_s(self, begin: str, end: str) -> float | None:
        if begin not in self.at_ns or end not in self.at_ns:
            return None
        return (self.at_ns[end] - self.at_ns[begin]) / NS_PER_S


class PathJoiner:
    """Joins messages of one person, whatever their order, into samples."""

    def __init__(self, wall_ns: Callable[[int], int], began_s: float) -> None:
        """Begin without samples.

        Args:
            wall_ns: converts a capture time (of the site's clock) to wall time, both Unix ns.
            began_s: start of listening, s (monotonic). Samples that are first heard within `SETTLE_S` are
                left out: their first messages may have been missed.
        """
        self._wall_ns = wall_ns
        self._ready_s = began_s + SETTLE_S
        self._open: OrderedDict[int, SamplePath] = OrderedDict()
        self._judged: OrderedDict[int, None] = OrderedDict()

    def add(self, hop: str, stamp_ns: int, sent_ns: int, process: str, now_s: float) -> None:
        """Add a message. Of several for the same hop, the first one published counts.

        Args:
            hop: a key of `CAUSES`.
            stamp_ns: its time of capture.
            sent_ns: its publication, wall time, Unix ns.
            process: id of the publishing process, or `""` if unknown.
            now_s: the present time, s (monotonic).
        """
        if stamp_ns in self._judged:
            return
        path = self._open.get(stamp_ns)
        if path is None:
            path = self._open[stamp_ns] = SamplePath(stamp_ns, {CAPTURE: self._wall_ns(stamp_ns)}, now_s)
            if len(self._open) > MAX_OPEN:
                self._open.popitem(last=False)
        if hop not in path.at_ns or sent_ns < path.at_ns[hop]:
            path.at_ns[hop] = sent_ns
            path.processes[hop] = process

    def settled(self, now_s: float) -> list[SamplePath]:
        """Return the samples that are `SETTLE_S` old, in order of arrival, and forget them."""
        paths: list[SamplePath] = []
        while self._open:
            stamp_ns, path = next(iter(self._open.items()))
            if now_s - path.first_s < SETTLE_S:
                break
            del self._open[stamp_ns]
            self._judged[stamp_ns] = None
            if len(self._judged) > MAX_OPEN:
                self._judged.popitem(last=False)
            if path.first_s >= self._ready_s and path.at_ns.keys() - SHARED > {CAPTURE}:
                paths.append(path)
        return paths


@dataclass(frozen=True, kw_only=True)
class HopFigures:
    """Times of one hop over several samples, s."""

    hop: str
    after: str
    """The hop before."""
    samples: int
    """Number of samples that reached it."""
    delta_p50_s: float | None
    """Median of the time since the hop before, or None if no sample was seen at both."""
    delta_p99_s: float | None
    total_p50_s: float | None
    """Median of the time since capture."""
    total_p99_s: float | None


def hop_figures(paths: Sequence[SamplePath]) -> list[HopFigures]:
    """Return the figures of each hop that any of `paths` reached, in order."""
    return [
        HopFigures(
            hop=hop,
            after=after,
            samples=sum(hop in path.at_ns for path in paths),
            delta_p50_s=_quantile(paths, SamplePath.delta_s, hop, 0.5),
            delta_p99_s=_quantile(paths, SamplePath.delta_s, hop, 0.99),
            total_p50_s=_quantile(paths, SamplePath.total_s, hop, 0.5),
            total_p99_s=_quantile(paths, SamplePath.total_s, hop, 0.99),
        )
        for hop, after in CAUSES.items()
        if any(hop in path.at_ns for path in paths)
    ]


def farthest(paths: Sequence[SamplePath]) -> SamplePath:
    """Return the newest of the `paths` that were seen at most hops. There must be one."""
    return max(paths, key=lambda path: (len(path.at_ns), path.stamp_ns))


def _quantile(
    paths: Sequence[SamplePath], span_s: Callable[[SamplePath, str], float | None], hop: str, share: float
) -> float | None:
    values = [value for path in paths if (value := span_s(path, hop)) is not None]
    # nearest rank: one of the values
    return float(np.quantile(values, share, method="inverted_cdf")) if values else None
