"""Detects a slow link to other machines, which delays everything that is shown; pure.

The site's time does not reveal it, since that comes over the same link. Health reports are stamped by the
clocks of their machines.
"""

from pointit.runtime.bus.timeliness import ClockSkewMonitor
from pointit.schemas import Health

WINDOW_S = 3.0
"""Window (s) of which the fastest report counts."""

LAG_S = 1.0
"""Delays above this are reported."""


class SlowLink:
    """Compares the stamps of other machines' reports with their arrival times."""

    def __init__(self, host: str) -> None:
        self._monitor = ClockSkewMonitor(host, WINDOW_S)

    def hear(self, health: Health, arrived_ns: int, now_s: float) -> None:
        """Process a report that arrived at `arrived_ns` (own clock, Unix ns); `now_s` is monotonic."""
        if health.host:
            self._monitor.on_report(health.host, health.stamp_ns, arrived_ns, now_s)

    def sentence(self, now_s: float) -> str:
        """Return a warning with its remedy, or `""` if there is no delay."""
        return "; ".join(
            f"messages of {skew.host} reach {self._monitor.here} {-skew.ahead_s:.1f} s late, so the page is "
            "behind: the link between the two machines is slow or full, or their clocks differ"
            for skew in self._monitor.skews(now_s)
            if skew.ahead_s <= -LAG_S
        )
