"""Host time of capture from a device's own clock: offset and drift, from arrivals that are only ever late.

A radio delivers samples in bursts, each later than it was captured. So only the fastest arrivals show how the
two clocks are related. The fastest of each second is a point (device time, delay). The relation is the line
along the edge of their lower convex hull at their mean: of all lines below all points the closest (Moon,
Skelly & Towsley, "Estimation and removal of clock skew from network delay measurements", INFOCOM 1999). The
shortest delay itself cannot be seen from one side, and remains.
"""

from collections import deque
from itertools import pairwise
from typing import NamedTuple

from pointit.schemas import NS_PER_S

Point = tuple[int, float]
"""Device time and delay, both relative to the first sample's, ns."""

BIN_NS = NS_PER_S
"""Device time of which the fastest arrival counts, ns."""
BINS = 60
"""Number of such points."""
SHRINK_NS = 3 * NS_PER_S
"""Device time after which half of the measured drift is believed, ns."""
MAX_DRIFT = 0.03
"""Largest drift, s/s. Resonators reach 0.01; beyond, the device's time is not in the stated unit."""
LATE_NS = NS_PER_S // 10
"""Two captures in succession after arrival by more (ns) mean that a clock was set; one alone is an outlier.
So does a delay that exceeds the shortest by more and stays; if it ends or varies, the link has stalled."""
STEADY_NS = NS_PER_S
"""Time for which it must stay within a factor of 2, ns."""
STEP_NS = NS_PER_S // 2
"""A step of the device's clock ahead by less (ns) is not reported: the link may have been slow until then."""
MAX_JUMPS = 3
"""Number of jumps within `UNUSED_NS` after which arrivals are used instead, for as long."""
UNUSED_NS = 30 * NS_PER_S
MAX_AGE_NS = NS_PER_S
"""Largest age of a stamp on arrival, ns."""


class Outliers(NamedTuple):
    """Samples in succession that do not fit the relation of the clocks."""

    first_ns: int
    """Arrival of the first one."""
    lowest: float
    """Smallest delay, ns."""
    highest: float


class DeviceClock:
    """Clock of one device, followed from sample to sample: it tells when each was captured, in our time.

    A wrist stamps its samples by a clock of its own, which has another zero and drifts. Their arrival is
    known in the host's time, but late by a delay that varies from sample to sample. The smallest delays are
    the honest ones: a line below all of them gives offset and drift of the device's clock.

    >>> clock = DeviceClock()
    >>> S = 1_000_000_000
    >>> delays_ms = [3, 40, 3, 25, 3]  # of samples every 10 ms, by a device that began 100 s ago
    >>> captured = [
    ...     clock.capture_ns(100 * S + 10_000_000 * n, 10_000_000 * n + 1_000_000 * delay)
    ...     for n, delay in enumerate(delays_ms)
    ... ]
    >>> [round(ns / 1e6) for ns in captured]
    [3, 13, 23, 33, 43]

    The delay that all samples share cannot be seen from the stamps: it stays in the result.
    """

    def __init__(self) -> None:
        self.jumps = 0
        """Number of times that a clock was set."""
        self.jump_s = 0.0
        """Step of the device's clock relative to the host's at the last of them, s."""
        self._jumped_ns: deque[int] = deque(maxlen=MAX_JUMPS)
        self._unused_until_ns: int | None = None
        self._newest_ns = 0
        self._outliers: Outliers | None = None
        self._offset = self._slope = 0.0
        self._points: deque[Point] = deque(maxlen=BINS)
        self._fastest: Point = (0, 0.0)
        self._fastest_late = 0.0
        self._bin_end = BIN_NS
        self.restart()

    def restart(self) -> None:
        """Forget both clocks: the device was connected, perhaps another."""
        self._begin: tuple[int, int] | None = None
        """Device time and arrival of the first sample, ns."""

    def restart_fallen(self, arrival_ns: int) -> None:
        """Forget both clocks: the device's fell. One that falls again and again is not used for a while."""
        self.restart()
        self._limit_jumps(arrival_ns)

    @property
    def is_used(self) -> bool:
        """Return False while the device's clock jumps again and again, or stands still."""
        return self._unused_until_ns is None

    @property
    def drift(self) -> float:
        """Return the drift of the device's clock, s/s; positive if it is fast."""
        return -self._slope if self._begin is not None else 0.0

    def capture_ns(self, device_ns: int, arrival_ns: int) -> int:
        """Return the host time of capture, ns: at most the arrival, and at most `MAX_AGE_NS` before it.

        It never decreases, unless the host's clock does.

        Args:
            device_ns: the device's clock at capture, without wraps.
            arrival_ns: the host's clock on arrival.
        """
        captured_ns = self._captured_ns(device_ns, arrival_ns)
        if captured_ns < self._newest_ns <= arrival_ns:
            return self._newest_ns
        self._newest_ns = captured_ns
        return captured_ns

    def _captured_ns(self, device_ns: int, arrival_ns: int) -> int:
        unused_until_ns = self._unused_until_ns
        if unused_until_ns is not None and self._is_unused(unused_until_ns - arrival_ns):
            return arrival_ns
        begin = self._begin
        if begin is None:
            self._start(device_ns, arrival_ns)
            return arrival_ns

        # Delay relative to the line through the fastest arrivals
        x = device_ns - begin[0]
        delay = arrival_ns - begin[1] - x
        late = delay - self._offset - self._slope * x

        # Faster than all before: the line goes down to it, unless a clock was set
        if late < 0.0:
            if late < -LATE_NS:
                if self._is_jump(late, arrival_ns):
                    return self._start_after_jump(device_ns, arrival_ns, late)
                return arrival_ns
            self._offset += late
            late = 0.0

        # Much slower: the link has stalled, or a clock was set
        if late <= LATE_NS:
            self._outliers = None
        elif self._is_jump(late, arrival_ns):
            return self._start_after_jump(device_ns, arrival_ns, late)

        # The fastest one of each bin becomes a point. A new bin begins with this sample.
        is_next = x >= self._bin_end
        if is_next:
            self._end_bin(x)
        if is_next or late <= self._fastest_late:
            self._fastest = (x, delay)
            self._fastest_late = late
        return arrival_ns - min(round(late), MAX_AGE_NS)

    def _start(self, device_ns: int, arrival_ns: int) -> None:
        self._begin = (device_ns, arrival_ns)
        self._offset = self._slope = 0.0
        self._points.clear()
        self._fastest = (0, 0.0)
        self._fastest_late = 0.0
        self._bin_end = BIN_NS
        self._outliers = None

    def _is_unused(self, remaining_ns: int) -> bool:
        """Return True if arrivals are used for `remaining_ns`; else start again."""
        if 0 <= remaining_ns <= UNUSED_NS:
            return True
        self._unused_until_ns = None
        self.restart()
        return False

    def _is_jump(self, late: float, arrival_ns: int) -> bool:
        """Return True if this delay and those before it mean that a clock was set."""
        outliers = self._outliers
        if outliers is None or arrival_ns < outliers.first_ns or (late < 0.0) != (outliers.lowest < 0.0):
            self._outliers = Outliers(arrival_ns, late, late)
            return False
        if late < 0.0:
            return True

        # A stalled link delivers with a delay that falls. That of a clock that was set stays.
        lowest = min(late, outliers.lowest)
        highest = max(late, outliers.highest)
        if arrival_ns - outliers.first_ns <= STEADY_NS:
            self._outliers = Outliers(outliers.first_ns, lowest, highest)
            return False
        self._outliers = None
        return highest < 2.0 * lowest

    def _start_after_jump(self, device_ns: int, arrival_ns: int, late: float) -> int:
        self._start(device_ns, arrival_ns)
        if -STEP_NS <= late < 0.0:  # the link may have been slow until now
            return arrival_ns
        self.jumps += 1
        self.jump_s = -late / NS_PER_S
        self._limit_jumps(arrival_ns)
        return arrival_ns

    def _limit_jumps(self, arrival_ns: int) -> None:
        jumped_ns = self._jumped_ns
        jumped_ns.append(arrival_ns)
        has_many = len(jumped_ns) == MAX_JUMPS
        if has_many and arrival_ns - jumped_ns[0] <= UNUSED_NS:
            self._unused_until_ns = arrival_ns + UNUSED_NS

    def _end_bin(self, x: int) -> None:
        self._points.append(self._fastest)
        self._bin_end = x - x % BIN_NS + BIN_NS
        points = self._points
        span = points[-1][0] - points[0][0]
        if span <= 0:
            return

        # Shrink the slope of a short span, which is mostly noise. Then no point is below the line.
        slope = slope_below(points) / (1.0 + (SHRINK_NS / span) ** 2)
        self._slope = min(max(slope, -MAX_DRIFT), MAX_DRIFT)
        self._offset = min(y - self._slope * px for px, y in points)


def slope_below(points: "deque[Point] | list[Point]") -> float:
    """Return the slope of the lower hull's edge at the mean of the abscissae; these ascend strictly."""
    hull: list[Point] = []
    for point in points:
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)

    # Among the lines below all points, the edge at the mean abscissa is closest to the points
    middle = sum(x for x, _ in points) / len(points)
    for (x0, y0), (x1, y1) in pairwise(hull):
        if x1 >= middle:
            return (y1 - y0) / (x1 - x0)
    return 0.0


def _turns_down(a: Point, b: Point, c: Point) -> bool:
    """Return True if b is not below the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
