"""Whether other machines' clocks are apart from this one's, from stamps and when they came; pure.

A message comes after it was stamped. So a stamp in the future tells for sure that its clock is ahead; one in
the past tells that its clock is behind, or that it took long. What takes long takes now more, now less: of
many reports the quickest counts, less what even this machine's own reports to itself take. A link that delays
everything by 50 ms and more cannot be told from a clock that is behind.
"""

import collections
from collections.abc import Iterator
from dataclasses import dataclass

from pointit.schemas.text import one_line

APART_S = 0.05
"""From here on latency figures of what crosses machines say little."""

REFUSED_S = 1.0
"""From here on samples are refused: they look old, or of the future."""

WINDOW_S = 20.0
"""The quickest report of so long counts; a clock that was set right is believed after it."""

LEAST_AHEAD = 2
LEAST_BEHIND = 8
"""Reports before a clock is said to be behind, unless they are steady."""

LEAST_STEADY = 3
LEAST_REFUSED = 2
"""The same of steady reports, and of steady ones that say more than `REFUSED_S`."""

STEADY = 0.25
"""Half of the reports differ from the quickest by less than this share: no delay is as even under load."""

MAX_HOSTS = 256

LONGEST_HOST = 64
"""Characters of a machine's name that are told apart and shown: its writer may be a stranger."""


@dataclass(frozen=True, kw_only=True)
class ClockSkew:
    """Difference between a machine's clock and this one's."""

    host: str
    ahead_s: float
    """At least so much when positive; behind, by at most so much, when negative."""

    @property
    def exceeds_limit(self) -> bool:
        """Return True if samples are refused because of it."""
        return abs(self.ahead_s) >= REFUSED_S

    def sentence(self, here: str) -> str:
        """Return a description of the difference, as seen from the machine `here`."""
        by = f"{abs(self.ahead_s) * 1e3:.0f} ms" if abs(self.ahead_s) < 1 else f"{abs(self.ahead_s):.1f} s"
        way = "ahead of" if self.ahead_s > 0 else "behind"
        unless = "" if self.ahead_s > 0 else ", unless its link alone takes so long"
        what = (
            "samples that cross the two are refused as too old or of the future"
            if self.exceeds_limit
            else "latency figures of what crosses the two are wrong by as much"
        )
        return f"the clock of machine {self.host} is {by} {way} the clock of {here}{unless}: {what}"


REMEDY = "synchronize both by NTP: `timedatectl set-ntp true`, or chrony on a site without internet"


class ClockSkewMonitor:
    """Compares stamps with the times of arrival, by the writer's host."""

    def __init__(self, here: str, window_s: float = WINDOW_S) -> None:
        """Take the name of this machine, and how long a report counts."""
        self.here = here
        self._window_s = window_s
        self._late: dict[str, collections.deque[tuple[float, float]]] = {}
        """By host: when a report came, and how much later than its stamp, s."""

    def on_report(self, host: str, stamp_ns: int, arrived_ns: int, now_s: float) -> None:
        """Take a report: stamped and arrived at these times of the wall, Unix ns; `now_s` is monotonic."""
        host = one_line(host, LONGEST_HOST)
        late = self._late.get(host)
        if late is None:
            if len(self._late) >= MAX_HOSTS:
                self._late.pop(min(self._late, key=lambda name: self._late[name][-1][0]))
            late = self._late[host] = collections.deque(maxlen=4096)
        late.append((now_s, (arrived_ns - stamp_ns) / 1e9))

    def skews(self, now_s: float) -> Iterator[ClockSkew]:
        """Yield the machines whose clocks are apart from this one's by `APART_S` and more."""
        for host, late in list(self._late.items()):
            while late and now_s - late[0][0] > self._window_s:
                late.popleft()
            if not late:
                del self._late[host]
        own = min((value for _, value in self._late.get(self.here, ())), default=0.0)
        for host, late in sorted(self._late.items()):
            if host == self.here:
                continue
            values = sorted(value for _, value in late)
            behind_s = values[0] - max(0.0, own)
            if values[0] <= -APART_S and len(values) >= LEAST_AHEAD:
                yield ClockSkew(host=host, ahead_s=-values[0])
            elif behind_s >= APART_S and _is_sure(values):
                yield ClockSkew(host=host, ahead_s=-behind_s)


def _is_sure(values: list[float]) -> bool:
    """Return True if delays alone do not explain `values` (sorted, s)."""
    if len(values) >= LEAST_BEHIND:
        return True
    if len(values) < (LEAST_REFUSED if values[0] >= REFUSED_S else LEAST_STEADY):
        return False
    return values[len(values) // 2] - values[0] <= STEADY * values[0]
