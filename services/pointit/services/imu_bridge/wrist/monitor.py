"""Report on the device on a wrist: rate, gaps, silence, a frozen device, reconnections, battery, signal."""

import math
from collections import deque
from collections.abc import Iterator

from pointit.services.imu_bridge.page_wrist import LOW_BATTERY

RATE_S = 5.0
"""Time over which the rate is averaged, s."""
GAPS_S = 60.0
"""Time over which gaps are counted, s."""
MIN_GAP_S = 0.1
"""Minimum pause that counts as a gap, s. Users notice a cursor that stops for this time."""
GAP_PERIODS = 4.0
"""Shortest pause that is a gap, in sample periods."""
FROZEN_S = 5.0
"""Time with one and the same orientation after which a device may have frozen, s. On people's arms it was at
most 0.2 s, and 1.2 s with radio loss (recordings of 7 people). Raw values are never the same for long."""
FINE = 1e-3
"""Smallest step of a quaternion's number seen from a device that shows the tremor of any arm. One with two
decimals is not judged."""
RAW = 6
"""Number of values of a raw reading."""
STORM = 5
"""Number of connections within `STORM_S` that are too many."""
STORM_S = 10.0
LATE_TICK_S = 1.0
"""Delay of a report after which silence is not judged: this machine had no time to listen."""
RATE, GAPS, BATTERY, SIGNAL = "rate", "gaps", "battery", "signal"
"""Names of metrics that viewers show."""
Values = tuple[float, ...]
Figure = tuple[str, float | None, str]
"""Name, value and unit of a metric. None removes it."""
WarningText = tuple[str, str]
"""Topic and message of a warning. `""` clears it."""


class WristMonitor:
    """Counts what one device sends. All times are monotonic, s."""

    def __init__(self, label: str, silence_s: float) -> None:
        """Monitor the device that is called `label` in warnings, which is silent after `silence_s`."""
        self._label = label
        self._silence_s = silence_s
        self.battery: float | None = None
        """Charge left, 0 to 1."""
        self.signal_dbm: float | None = None
        self._is_connected = False
        self._lost = ""
        """Reason why the device is disconnected, or `""`."""
        self._connections: deque[float] = deque(maxlen=STORM)
        self._count = 0
        """Readings since the last report."""
        self._counts: deque[tuple[float, int]] = deque()
        """Time and readings of reports."""
        self._last_s = -math.inf
        self._gap_s = math.inf
        """Shortest pause that is a gap, s."""
        self._gaps: deque[float] = deque(maxlen=1000)
        self._latest_gap_s: float | None = None
        self._reported_s: float | None = None
        self._values: Values = ()
        self._changed_s = math.inf
        self._finest = math.inf
        self._is_step_wanted = True
        self._is_late = False

    def on_reading(self, values: Values, now_s: float) -> None:
        """Count a reading of the numbers `values`."""
        pause_s = now_s - self._last_s
        if pause_s > self._gap_s:
            self._gaps.append(now_s)
            self._latest_gap_s = pause_s
        self._count += 1
        self._last_s = now_s
        if values != self._values:
            if self._is_step_wanted and len(values) == len(self._values):
                self._is_step_wanted = False
                step = max(abs(a - b) for a, b in zip(values, self._values, strict=True))
                self._finest = min(self._finest, step)
            self._values = values
            self._changed_s = now_s

    def on_connected(self, now_s: float) -> None:
        """Record a new connection."""
        self._is_connected = True
        self._lost = ""
        self._connections.append(now_s)
        self._last_s, self._gap_s = now_s, math.inf
        self._counts.clear()
        self._values, self._changed_s, self._finest = (), math.inf, math.inf

    def on_disconnected(self, reason: str) -> None:
        """Record the loss of the device for `reason`. `""`: it has ended without an error."""
        self._is_connected = False
        self._lost = reason
        self.signal_dbm = None

    def report(self, now_s: float) -> Iterator[Figure]:
        """Yield the metrics; to be called about once a second."""
        before_s, self._reported_s = self._reported_s, now_s
        counts = self._counts
        counts.append((now_s, self._count))
        self._count = 0
        while now_s - counts[0][0] > RATE_S:
            counts.popleft()
        span_s = now_s - counts[0][0]
        rate_hz = sum(count for _, count in list(counts)[1:]) / span_s if span_s > 0.0 else 0.0
        if rate_hz > 0.0:
            self._gap_s = max(MIN_GAP_S, GAP_PERIODS / rate_hz)
        self._is_step_wanted = True
        self._is_late = before_s is not None and now_s - before_s > 1.0 + LATE_TICK_S
        while self._gaps and now_s - self._gaps[0] > GAPS_S:
            self._gaps.popleft()
        is_shown = self._last_s > -math.inf
        yield RATE, round(rate_hz, 1) if is_shown else None, "Hz"
        yield GAPS, float(len(self._gaps)) if is_shown else None, "/min"
        latest_gap_s = self._latest_gap_s
        yield "latest gap", None if latest_gap_s is None else round(1e3 * latest_gap_s), "ms"
        yield BATTERY, None if self.battery is None else round(100.0 * self.battery), "%"
        yield SIGNAL, self.signal_dbm, "dBm"

    def warnings(self, now_s: float, *, is_explained: bool = False) -> Iterator[WarningText]:
        """Yield the warnings, as of the last report.

        Args:
            now_s: the time, s.
            is_explained: the source itself reports why nothing comes.
        """
        label = self._label
        yield "connection", self._lost
        silent_s = now_s - self._last_s
        is_judged = self._is_connected and not self._is_late and not is_explained
        is_silent = is_judged and silent_s > self._silence_s
        yield (
            "silence",
            f"{label} is connected, but has sent nothing for {silent_s:.0f} s: move it, wake it up, or "
            "switch it off and on"
            if is_silent
            else "",
        )
        same_s = self._last_s - self._changed_s
        is_frozen = same_s > FROZEN_S and (self._finest < FINE or len(self._values) == RAW)
        yield (
            "frozen",
            f"{label} has sent the same orientation for {same_s:.0f} s: it lies on a table, or has frozen; "
            "if the warning stays when it is moved, switch it off and on"
            if is_frozen
            else "",
        )
        connections = self._connections
        is_storm = len(connections) == STORM and now_s - connections[0] < STORM_S
        yield (
            "reconnections",
            f"{label} was connected {STORM} times within {STORM_S:g} s: charge it, go nearer, or look for "
            "another program that connects to it"
            if is_storm
            else "",
        )
        is_low = self.battery is not None and self.battery < LOW_BATTERY
        yield "wrist battery", f"the battery of {label} is at {self.battery:.0%}: charge it" if is_low else ""
