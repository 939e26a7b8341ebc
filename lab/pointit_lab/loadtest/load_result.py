"""Results of a load test, its pass criterion, and the search for the largest load; pure."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from pointit.schemas.text import round_beyond

P99_MS = 50.0
"""Limit of the 99th percentile from wrist to light: more feels detached from the hand."""

MAX_DROPPED = 0.001
"""Share of samples that a busy machine may conflate; more count as drops."""

MIN_SENT = 0.99
"""Share of the planned samples sent; with fewer, the machine could not even drive the wrists."""


@dataclass(frozen=True, kw_only=True)
class Usage:
    """Resource usage of a process during the measurement."""

    name: str
    cpu: float
    """CPU time relative to one core; 1.0 is all of it."""
    memory_mb: float


@dataclass(frozen=True, kw_only=True)
class LinkUsage:
    """Traffic of a link between two machines during the measurement, per second."""

    name: str
    """`host 2 > host 1`: from the lower to the upper one."""
    up_bytes_hz: float
    up_packets_hz: float
    down_bytes_hz: float
    down_packets_hz: float
    up_hz: Mapping[str, float]
    """Messages by kind, unless the link is encrypted."""
    down_hz: Mapping[str, float]
    counted_s: float
    """Time in which these were counted, after the measurement."""

    def row(self) -> dict[str, Any]:
        """Return a row of the table."""
        return {
            "link": self.name,
            "up_kB_per_s": round(self.up_bytes_hz / 1e3, 2),
            "down_kB_per_s": round(self.down_bytes_hz / 1e3, 2),
            "up_packets_per_s": round(self.up_packets_hz),
            "down_packets_per_s": round(self.down_packets_hz),
            "up": _kinds(self.up_hz),
            "down": _kinds(self.down_hz),
        }


@dataclass(frozen=True, kw_only=True)
class LoadResult:
    """One measurement."""

    users: int
    rate_hz: float
    duration_s: float
    layout: str
    sent: int
    """Samples of all wrists."""
    pointed: int
    """Cursors that followed."""
    hovered: int
    """Hovers that followed."""
    arrived: int | None = None
    """Cursors that reached the site's lights. None: not counted."""
    light_s: Sequence[float]
    """Latency from wrist to light: ages of new frames on arrival."""
    cursor_s: Sequence[float]
    """Latency from wrist to cursor."""
    processes: Sequence[Usage]
    load_average: float | None
    """Load average of the machine over the last minute, including other work."""
    hosts: int = 0
    """Number of hosts with people. 0: they are not simulated."""
    lacking: str = ""
    """Reason why the hosts were processes on loopback whose links are not measured, or `""`."""
    links: Sequence[LinkUsage] = ()
    """Links between the machines, as far as known."""

    @property
    def dropped(self) -> float:
        """Return the share of samples without a cursor."""
        if not self.sent:
            return 1.0
        return max(0.0, 1.0 - self.pointed / self.sent)

    @property
    def lost(self) -> float | None:
        """Return the share of cursors that did not reach the site's lights, if they are counted."""
        if self.arrived is None:
            return None
        if not self.pointed:
            return 1.0
        return max(0.0, 1.0 - self.arrived / self.pointed)

    @property
    def sent_share(self) -> float:
        """Return the share of samples that were sent in time."""
        planned = self.users * self.rate_hz * self.duration_s
        return self.sent / planned

    @property
    def us_per_sample(self) -> float:
        """Return the CPU time of all processes for one sample, us."""
        per_s = self.sent / self.duration_s
        if not per_s:
            return 0.0
        cpu = sum(usage.cpu for usage in self.processes)
        return cpu / per_s * 1e6

    def process_rows(self) -> list[dict[str, Any]]:
        """Return for each process its CPU time for one sample of all wrists, us, and its memory."""
        per_s = self.sent / self.duration_s
        rows: list[dict[str, Any]] = []
        for usage in self.processes:
            us_per_sample = None
            if per_s:
                us_per_sample = round(usage.cpu / per_s * 1e6)
            memory_mb = round(usage.memory_mb)
            rows.append({"process": usage.name, "us_per_sample": us_per_sample, "memory_mb": memory_mb})
        return rows

    def link_rows(self) -> list[dict[str, Any]]:
        """Return for each link its traffic, and its bytes for one sample of all wrists."""
        per_s = self.sent / self.duration_s
        rows: list[dict[str, Any]] = []
        for link in self.links:
            bytes_hz = link.up_bytes_hz + link.down_bytes_hz
            bytes_per_sample = round(bytes_hz / per_s) if per_s else None
            rows.append({**link.row(), "bytes_per_sample": bytes_per_sample})
        return rows

    @property
    def failure(self) -> str:
        """Return the reason why the load was not carried, or `""` if it was."""
        # What was never sent comes first: with it, all other figures say nothing.
        if self.sent_share < MIN_SENT:
            percent = round_beyond(100 * self.sent_share, 100 * MIN_SENT, 0)
            return f"only {percent}% of the samples could be sent"
        p99_ms = quantile_ms(self.light_s, 0.99)
        if p99_ms is None:
            return "no light followed any sample"
        if self.dropped > MAX_DROPPED:
            return f"{self.dropped:.1%} of the samples were dropped"
        if self.lost is not None and self.lost > MAX_DROPPED:
            return f"{self.lost:.1%} of the cursors did not reach the lights"
        if p99_ms > P99_MS:
            shown_ms = round_beyond(p99_ms, P99_MS, 0)
            return f"p99 is {shown_ms} ms, above {P99_MS:.0f} ms"
        return ""

    def row(self) -> dict[str, Any]:
        """Return a row of the table."""
        # The order of the entries is that of the columns.
        row: dict[str, Any] = {}
        if self.hosts:
            row["hosts"] = self.hosts
        row["users"] = self.users
        row["light_p50_ms"] = _rounded(quantile_ms(self.light_s, 0.5))
        row["light_p99_ms"] = _rounded(quantile_ms(self.light_s, 0.99))
        row["cursor_p50_ms"] = _rounded(quantile_ms(self.cursor_s, 0.5))
        row["cursor_p99_ms"] = _rounded(quantile_ms(self.cursor_s, 0.99))
        row["drops_percent"] = round(self.dropped * 100, 3)
        if self.lost is not None:
            row["lost_percent"] = round(self.lost * 100, 3)

        cpu = sum(usage.cpu for usage in self.processes)
        memory_mb = sum(usage.memory_mb for usage in self.processes)
        busiest = max(self.processes, key=lambda usage: usage.cpu)
        row["processes"] = len(self.processes)
        row["cpu_percent"] = round(cpu * 100)
        row["us_per_sample"] = round(self.us_per_sample)
        busiest_percent = busiest.cpu * 100
        row["busiest"] = f"{busiest.name} {busiest_percent:.0f} %"
        row["memory_mb"] = round(memory_mb)
        row["load"] = self.load_average
        row["carried"] = self.failure or "yes"
        return row

    def record(self) -> dict[str, Any]:
        """Return all values, for programs."""
        # Replaced entries keep their place: `carried` is a boolean here, `processes` a list.
        record = self.row()
        record["carried"] = not self.failure
        record["failure"] = self.failure
        record["layout"] = self.layout
        record["rate_hz"] = self.rate_hz
        record["duration_s"] = self.duration_s
        record["sent"] = self.sent
        record["cursors"] = self.pointed
        record["hovers"] = self.hovered
        record["frames"] = len(self.light_s)
        record["light_max_ms"] = _rounded(quantile_ms(self.light_s, 1.0))
        record["processes"] = [asdict(usage) for usage in self.processes]
        record["lacking"] = self.lacking
        record["links"] = [asdict(link) for link in self.links]
        return record


def quantile_ms(values_s: Sequence[float], share: float) -> float | None:
    """Return the nearest-rank quantile in ms, or None without values."""
    if not values_s:
        return None
    rank = math.ceil(share * len(values_s))
    index = max(0, rank - 1)
    return sorted(values_s)[index] * 1e3


class CapacitySearch:
    """Search for the largest load: doubles it until it fails, then bisects."""

    def __init__(self, first: int, max_count: int, steps: int = 3) -> None:
        """Start with `first`, try at most `max_count`, bisect at most `steps` times."""
        self.carried = 0
        self._failed: int | None = None
        self._first = first
        self._max_count = max_count
        self._steps = steps

    def counts(self) -> Iterator[int]:
        """Yield the loads to try. Call `report` before requesting the next."""
        count = min(self._first, self._max_count)
        while self._failed is None:
            yield count
            if self.carried >= self._max_count:
                return
            count = min(2 * count, self._max_count)
        for _ in range(self._steps):
            count = (self.carried + self._failed) // 2
            if count in (self.carried, self._failed):
                return
            yield count

    def report(self, count: int, *, carried: bool) -> None:
        """Record the outcome of a load."""
        if carried:
            self.carried = max(self.carried, count)
        elif self._failed is None:
            self._failed = count
        else:
            self._failed = min(self._failed, count)


def _kinds(rates_hz: Mapping[str, float]) -> list[str]:
    kinds: list[str] = []
    for kind, rate_hz in sorted(rates_hz.items()):
        if round(rate_hz):
            kinds.append(f"{kind} {rate_hz:.0f}")
    return kinds


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 2)
