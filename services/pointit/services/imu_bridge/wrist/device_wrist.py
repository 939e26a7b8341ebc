"""The device of one person: from its items to orientations in host time, and the report on it.

Host time of capture from the device's own clock: offset and drift, from arrivals that are only ever late.

A radio delivers samples in bursts, each later than it was captured. So only the fastest arrivals show how the
two clocks are related. The fastest of each second is a point (device time, delay). The relation is the line
along the edge of their lower convex hull at their mean: of all lines below all points the closest (Moon,
Skelly & Towsley, "Estimation and removal of clock skew from network delay measurements", INFOCOM 1999). The
shortest delay itself cannot be seen from one side, and remains.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, pairwise
from typing import NamedTuple, Protocol

from pointit.geometry.rotation import Quaternion
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import load_object
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.arm_frame import YawEpoch
from pointit.services.imu_bridge.reading import (
    Battery,
    Disconnected,
    Item,
    RawReading,
    Reading,
    ReadingCheck,
    Reconnected,
    Signal,
)
from pointit.services.imu_bridge.wrist.monitor import Figure, WarningText, WristMonitor

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
Point = tuple[int, float]
"""Device time and delay, both relative to the first sample's, ns."""


class DeviceClock:
    """Clock of one device, followed from sample to sample."""

    def __init__(self) -> None:
        self.jumps = 0
        """Number of times that a clock was set."""
        self.jump_s = 0.0
        """Step of the device's clock relative to the host's at the last of them, s."""
        self._jumped_ns: deque[int] = deque(maxlen=MAX_JUMPS)
        self._unused_until_ns: int | None = None
        self._newest_ns = 0
        self._off: tuple[int, float, float] | None = None
        """Arrival of the first of the samples that do not fit, their smallest and largest delay, ns."""
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
        if self._unused_until_ns is not None and self._is_unused(self._unused_until_ns - arrival_ns):
            return arrival_ns
        begin = self._begin
        if begin is None:
            self._start(device_ns, arrival_ns)
            return arrival_ns
        x = device_ns - begin[0]
        delay = arrival_ns - begin[1] - x
        late = delay - self._offset - self._slope * x
        if late < 0.0:
            if late < -LATE_NS:
                is_new = self._is_off_again(late, arrival_ns)
                return self._jumped(device_ns, arrival_ns, late) if is_new else arrival_ns
            self._offset += late
            late = 0.0
        if late <= LATE_NS:
            self._off = None
        elif self._is_off_again(late, arrival_ns):
            return self._jumped(device_ns, arrival_ns, late)
        is_next = x >= self._bin_end
        if is_next:
            self._end_bin(x)
        if is_next or late <= self._fastest_late:
            self._fastest, self._fastest_late = (x, delay), late
        return arrival_ns - min(round(late), MAX_AGE_NS)

    def _start(self, device_ns: int, arrival_ns: int) -> None:
        self._begin = (device_ns, arrival_ns)
        self._offset = self._slope = 0.0
        self._points.clear()
        self._fastest, self._fastest_late = (0, 0.0), 0.0
        self._bin_end = BIN_NS
        self._off = None

    def _is_unused(self, left_ns: int) -> bool:
        """Return True if arrivals are used for `left_ns` more; else start again."""
        if 0 <= left_ns <= UNUSED_NS:
            return True
        self._unused_until_ns = None
        self.restart()
        return False

    def _is_off_again(self, late: float, arrival_ns: int) -> bool:
        off = self._off
        if off is None or arrival_ns < off[0] or (late < 0.0) != (off[1] < 0.0):
            self._off = (arrival_ns, late, late)
            return False
        if late < 0.0:
            return True
        since_ns, lowest, highest = off[0], min(late, off[1]), max(late, off[2])
        if arrival_ns - since_ns <= STEADY_NS:
            self._off = (since_ns, lowest, highest)
            return False
        self._off = None
        return highest < 2.0 * lowest

    def _jumped(self, device_ns: int, arrival_ns: int, late: float) -> int:
        self._start(device_ns, arrival_ns)
        if -STEP_NS <= late < 0.0:
            return arrival_ns
        self.jumps += 1
        self.jump_s = -late / NS_PER_S
        self._limit_jumps(arrival_ns)
        return arrival_ns

    def _limit_jumps(self, arrival_ns: int) -> None:
        jumped_ns = self._jumped_ns
        jumped_ns.append(arrival_ns)
        if len(jumped_ns) == MAX_JUMPS and arrival_ns - jumped_ns[0] <= UNUSED_NS:
            self._unused_until_ns = arrival_ns + UNUSED_NS

    def _end_bin(self, x: int) -> None:
        self._points.append(self._fastest)
        self._bin_end = x - x % BIN_NS + BIN_NS
        points = self._points
        span = points[-1][0] - points[0][0]
        if span <= 0:
            return
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
    middle = sum(x for x, _ in points) / len(points)
    for (x0, y0), (x1, y1) in pairwise(hull):
        if x1 >= middle:
            return (y1 - y0) / (x1 - x0)
    return 0.0


def _turns_down(a: Point, b: Point, c: Point) -> bool:
    """Return True if b is not below the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])


SHOWN_S = 10.0
"""Time for which a jump of a clock is reported, s."""
FUSION = "pointit.services.imu_bridge.wrist.fusion:Fusion"
"""Class that computes orientations from raw readings, which only some devices deliver."""


class RawFusion(Protocol):
    """Orientation of one sensor from its raw readings."""

    restarts: int
    """Number of restarts after the first start: each has another yaw origin."""

    def restart(self) -> None:
        """Start again: readings were lost, or the device was moved without them."""
        ...

    def update(self, reading: RawReading) -> Quaternion | None:
        """Return the orientation, or None while there is none."""
        ...

    def report(self, now_s: float) -> Iterator[Figure]:
        """Yield metrics; to be called about once a second."""
        ...

    def warning(self, label: str) -> str:
        """Return a message about the device called `label`, or `""`."""
        ...


class SensorSample(NamedTuple):
    """One orientation of the sensor."""

    stamp_ns: int
    """Host time of capture, as far as the device's clock tells it; else that of the reading."""
    world_from_sensor: Quaternion
    device_time_ns: int | None
    """The device's clock without wraps, or None if it has none that runs."""


class DeviceWrist:
    """Processes all that one source delivers."""

    def __init__(
        self, label: str, plugin: str, epoch: YawEpoch, *, silence_s: float, has_steady_time: bool
    ) -> None:
        """Create without a device.

        Args:
            label: its name in warnings.
            plugin: name of the source in warnings about wrong readings.
            epoch: counts its yaw origins.
            silence_s: time without a reading after which a connected device is silent, s.
            has_steady_time: the host's clock runs at the speed of the wall's, so that a device's compares.
        """
        self.epoch = epoch
        self.monitor = WristMonitor(label, silence_s)
        self.newest: Quaternion | None = None
        """Newest world_from_sensor."""
        self.has_changed = False
        """True if the last item may have changed a warning."""
        self._label = label
        self._plugin = plugin
        self._check = ReadingCheck()
        self._problem = ""
        self._clock = DeviceClock() if has_steady_time else None
        self._has_device_time = False
        self._age_ns = 0
        """Largest age of a reading on arrival since the last report, by the device's clock."""
        self._jumps = 0
        self._jump_shown_s = 0.0
        self._fusion: RawFusion | None = None
        self._no_fusion = ""
        """Reason why raw readings cannot be used, or `""`."""

    def take(self, item: Item, now_ns: int, now_s: float) -> SensorSample | None:
        """Process `item`. Return its orientation, or None without one, or if it cannot be used.

        Args:
            item: as delivered. A `Press` is only checked: see `is_refused`.
            now_ns: the host's clock.
            now_s: the monotonic time.
        """
        problem = self._check.problem(item, now_ns)
        self.has_changed = problem != self._problem
        self._problem = problem
        if self._check.is_refused and not isinstance(item, Reconnected | Disconnected):
            return None
        if isinstance(item, Reading):
            orientation = self.newest = item.world_from_sensor
            self.monitor.on_reading(orientation, now_s)
            stamp_ns, device_ns = self._timed(item)
            return SensorSample(stamp_ns, orientation, device_ns)
        if isinstance(item, RawReading):
            self.monitor.on_reading((*item.angular_velocity_radps, *item.acceleration_mps2), now_s)
            stamp_ns, device_ns = self._timed(item)
            fused = self._fused(
                item if device_ns == item.device_time_ns else replace(item, device_time_ns=device_ns)
            )
            if fused is None:
                return None
            self.newest = fused
            return SensorSample(stamp_ns, fused, device_ns)
        self.has_changed = True
        if isinstance(item, Battery):
            self.monitor.battery = item.level
        elif isinstance(item, Signal):
            self.monitor.signal_dbm = item.dbm
        elif isinstance(item, Reconnected):
            self._on_connected(item, now_s)
        elif isinstance(item, Disconnected):
            self.monitor.on_disconnected(item.reason)
        return None

    @property
    def is_refused(self) -> bool:
        """Return True if the last item must not be used."""
        return self._check.is_refused

    def report(self, now_s: float) -> Iterator[Figure]:
        """Yield the metrics; to be called about once a second."""
        clock = self._clock
        is_timed = clock is not None and self._has_device_time and clock.is_used
        drift = clock.drift if clock is not None and is_timed else None
        clock_figure: Figure = ("clock drift", None if drift is None else round(1e6 * drift), "ppm")
        age: Figure = ("age", round(self._age_ns / 1e6) if is_timed else None, "ms")
        self._age_ns = 0
        fusion = () if self._fusion is None else self._fusion.report(now_s)
        return chain(self.monitor.report(now_s), (clock_figure, age), fusion)

    def warnings(self, now_s: float, *, is_explained: bool) -> Iterator[WarningText]:
        """Yield the warnings. `is_explained`: the source itself reports why nothing comes."""
        yield "readings", f"{self._plugin} {self._problem}" if self._problem else ""
        yield "fusion", f"{self._plugin} {self._no_fusion}" if self._no_fusion else ""
        yield "clock", self._clock_warning(now_s)
        if self._fusion is not None:
            yield "drift", self._fusion.warning(self._label)
        yield from self.monitor.warnings(now_s, is_explained=is_explained)

    def _on_connected(self, item: Reconnected, now_s: float) -> None:
        self.monitor.on_connected(now_s)
        if self._fusion is not None:
            self._fusion.restart()
        if self._clock is not None:
            self._clock.restart()
        self.epoch.reconnected(keeps_yaw=item.keeps_yaw and self._fusion is None)

    def _timed(self, item: Reading | RawReading) -> tuple[int, int | None]:
        """Return the time of capture, and the device's without wraps or None if it has none that runs, ns."""
        stamp_ns, epoch, clock = item.stamp_ns, self.epoch, self._clock
        if clock is not None and not clock.is_used and item.device_time_ns is not None:
            return clock.capture_ns(item.device_time_ns, stamp_ns), None
        origin = epoch.count
        device_ns = epoch.read(item.device_time_ns)  # always, to detect restarts
        if device_ns is None or clock is None:
            return stamp_ns, device_ns
        self._has_device_time = True
        if epoch.count != origin:
            clock.restart_fallen(stamp_ns)
        captured_ns = clock.capture_ns(device_ns, stamp_ns)
        self._age_ns = max(self._age_ns, stamp_ns - captured_ns)
        return captured_ns, device_ns if clock.is_used else None

    def _fused(self, item: RawReading) -> Quaternion | None:
        fusion = self._fusion
        if fusion is None:
            if self._no_fusion:
                return None
            try:
                fusion = load_object(FUSION, "sends raw readings, whose fusion")()
            except ConfigError as error:
                self._no_fusion = str(error)
                return None
            self._fusion = fusion
        restarts = fusion.restarts
        orientation = fusion.update(item)
        if fusion.restarts != restarts:
            self.epoch.start_new_epoch()
        return orientation

    def _clock_warning(self, now_s: float) -> str:
        clock = self._clock
        if clock is None:
            return ""
        if not clock.is_used:
            return (
                f"the clock of {self._label} stands still, jumps, or is not as fast as this machine's, so "
                "times of arrival are used: check the unit of its time, and whether two devices send"
            )
        if clock.jumps != self._jumps:
            self._jumps, self._jump_shown_s = clock.jumps, now_s
        if not clock.jumps or now_s - self._jump_shown_s > SHOWN_S:
            return ""
        return f"the clock of {self._label} jumped by {clock.jump_s:+.1f} s, or this machine's was set"
