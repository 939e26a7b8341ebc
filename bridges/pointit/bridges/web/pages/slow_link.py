"""Whether what is shown is long past: a link that carries less than a page is sent holds all of it up; pure.

By the site's time nothing is late: that comes over the same link. Reports of health are stamped by the
clocks of their machines.
"""

from collections.abc import Iterator

from pointit.runtime.health.clock_skew import ClockSkewMonitor
from pointit.schemas import Health

WINDOW_S = 3.0
"""The quickest report of so long counts."""

LAG_S = 1.0
"""What is later is told."""


class SlowLink:
    """Compares when reports of other machines were written with when they came."""

    def __init__(self, host: str) -> None:
        """Take the name of this machine."""
        self._watch = ClockSkewMonitor(host, WINDOW_S)

    def hear(self, health: Health, arrived_ns: int, now_s: float) -> None:
        """Take a report that arrived at a time of this machine's clock, Unix ns; `now_s` is monotonic."""
        if health.host:
            self._watch.on_report(health.host, health.stamp_ns, arrived_ns, now_s)

    def sentence(self, now_s: float) -> str:
        """Return what is wrong and what to do; empty when nothing is."""
        return "; ".join(self._sentences(now_s))

    def _sentences(self, now_s: float) -> Iterator[str]:
        for skew in self._watch.skews(now_s):
            if skew.ahead_s <= -LAG_S:
                yield (
                    f"what machine {skew.host} sends comes to {self._watch.here} {-skew.ahead_s:.1f} s late, "
                    "and the page shows what was then: the link between the two is too slow or too full, "
                    "unless their clocks are apart"
                )
