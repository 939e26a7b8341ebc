"""The device of one person: from its items to orientations in host time, and the report on it."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple, Protocol

from pointit.geometry.rotation import Quaternion
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import OptionalPart, load_object, present
from pointit.services.imu_bridge.arm_frame import YawEpoch
from pointit.services.imu_bridge.orientation_check import FrozenCheck, Values
from pointit.services.imu_bridge.page_wrist import LOW_BATTERY
from pointit.services.imu_bridge.sources import (
    Battery,
    Disconnected,
    Item,
    RawReading,
    Reading,
    ReadingCheck,
    Reconnected,
    Signal,
)

Figure = tuple[str, float | None, str]
"""Name, value and unit of a metric. None removes it."""
WarningText = tuple[str, str]
"""Topic and message of a warning. `""` clears it."""

RATE_S = 5.0
"""Time over which the rate is averaged, s."""
GAPS_S = 60.0
"""Time over which gaps are counted, s."""
MIN_GAP_S = 0.1
"""Minimum pause that counts as a gap, s. Users notice a cursor that stops for this time."""
GAP_PERIODS = 4.0
"""Shortest pause that is a gap, in sample periods."""
STORM = 5
"""Number of connections within `STORM_S` that are too many."""
STORM_S = 10.0
LATE_TICK_S = 1.0
"""Delay of a report after which silence is not judged: this machine had no time to listen."""
RATE = "rate"
"""Name of a metric that viewers show, as are those below."""
GAPS = "gaps"
BATTERY = "battery"
SIGNAL = "signal"
CLOCK: "OptionalPart[type[CaptureClock]]" = OptionalPart(
    "pointit.services.imu_bridge.device_clock:DeviceClock"
)
"""Class that follows a device's own clock, which only devices have. Without it, times of arrival are used."""
SHOWN_S = 10.0
"""Time for which a jump of a clock is reported, s."""
FUSION = "pointit.services.imu_bridge.fusion:Fusion"
"""Class that computes orientations from raw readings, which only some devices deliver."""


class WristMonitor:
    """Counts what one device sends. All times are monotonic, s."""

    def __init__(self, label: str, silence_s: float) -> None:
        """Monitor the device that is called `label` in warnings, which is silent after `silence_s`."""
        self._label = label
        self._silence_s = silence_s
        self.battery: float | None = None
        """Charge left, 0 to 1."""
        self.signal_dbm: float | None = None

        # Connections
        self._is_connected = False
        self._lost = ""
        """Reason why the device is disconnected, or `""`."""
        self._connections: deque[float] = deque(maxlen=STORM)

        # Rate of the readings, and gaps in it
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

        self._frozen = FrozenCheck()
        self._is_late = False

    def on_reading(self, values: Values, now_s: float) -> None:
        """Count a reading of the numbers `values`."""
        pause_s = now_s - self._last_s
        if pause_s > self._gap_s:
            self._gaps.append(now_s)
            self._latest_gap_s = pause_s
        self._count += 1
        self._last_s = now_s
        self._frozen.on_values(values, now_s)

    def on_connected(self, now_s: float) -> None:
        """Record a new connection."""
        self._is_connected = True
        self._lost = ""
        self._connections.append(now_s)
        self._last_s = now_s
        self._gap_s = math.inf
        self._counts.clear()
        self._frozen.restart()

    def on_disconnected(self, reason: str) -> None:
        """Record the loss of the device for `reason`. `""`: it has ended without an error."""
        self._is_connected = False
        self._lost = reason
        self.signal_dbm = None

    def report(self, now_s: float) -> Iterator[Figure]:
        """Yield the metrics; to be called about once a second."""
        previous_s = self._reported_s
        self._reported_s = now_s
        self._frozen.on_report()
        self._is_late = previous_s is not None and now_s - previous_s > 1.0 + LATE_TICK_S

        # Rate over the last reports, whose first count belongs to the time before
        counts = self._counts
        counts.append((now_s, self._count))
        self._count = 0
        while now_s - counts[0][0] > RATE_S:
            counts.popleft()
        span_s = now_s - counts[0][0]
        rate_hz = 0.0
        if span_s > 0.0:
            readings = sum(count for _, count in list(counts)[1:])
            rate_hz = readings / span_s
        if rate_hz > 0.0:
            self._gap_s = max(MIN_GAP_S, GAP_PERIODS / rate_hz)
        while self._gaps and now_s - self._gaps[0] > GAPS_S:
            self._gaps.popleft()

        # None removes a metric
        shown_rate_hz: float | None = None
        gaps_per_min: float | None = None
        if self._last_s > -math.inf:
            shown_rate_hz = round(rate_hz, 1)
            gaps_per_min = float(len(self._gaps))
        yield RATE, shown_rate_hz, "Hz"
        yield GAPS, gaps_per_min, "/min"
        yield "latest gap", _scaled(self._latest_gap_s, 1e3), "ms"
        yield BATTERY, _scaled(self.battery, 100.0), "%"
        yield SIGNAL, self.signal_dbm, "dBm"

    def warnings(self, now_s: float, *, is_explained: bool = False) -> Iterator[WarningText]:
        """Yield the warnings, as of the last report.

        Args:
            now_s: the time, s.
            is_explained: the source itself reports why nothing comes.
        """
        label = self._label
        yield "connection", self._lost

        # Silence. After a late report, readings may be waiting for this process itself.
        silent_s = now_s - self._last_s
        can_judge = self._is_connected and not self._is_late and not is_explained
        message = ""
        if can_judge and silent_s > self._silence_s:
            message = (
                f"{label} is connected, but has sent nothing for {silent_s:.0f} s: move it, wake it up, or "
                "switch it off and on"
            )
        yield "silence", message

        message = ""
        frozen_s = self._frozen.frozen_s
        if frozen_s:
            message = (
                f"{label} has sent the same orientation for {frozen_s:.0f} s: it lies on a table, or has "
                "frozen; if the warning stays when it is moved, switch it off and on"
            )
        yield "frozen", message

        # Many connections in succession hint at a weak signal, or at a second program
        connections = self._connections
        message = ""
        if len(connections) == STORM and now_s - connections[0] < STORM_S:
            message = (
                f"{label} was connected {STORM} times within {STORM_S:g} s: charge it, go nearer, or look "
                "for another program that connects to it"
            )
        yield "reconnections", message

        # Battery
        message = ""
        if self.battery is not None and self.battery < LOW_BATTERY:
            message = f"the battery of {label} is at {self.battery:.0%}: charge it"
        yield "wrist-battery", message


def _scaled(value: float | None, factor: float) -> float | None:
    """Return `value` times `factor`, rounded, or None if it is None."""
    if value is None:
        return None
    return round(factor * value)


class CaptureClock(Protocol):
    """Clock of one device, followed from sample to sample."""

    jumps: int
    """Number of times that a clock was set."""
    jump_s: float
    """Step of the device's clock relative to the host's at the last of them, s."""

    def restart(self) -> None:
        """Forget both clocks: the device was connected, perhaps another."""
        ...

    def restart_fallen(self, arrival_ns: int) -> None:
        """Forget both clocks: the device's fell."""
        ...

    @property
    def is_used(self) -> bool:
        """Return False while the device's clock jumps again and again, or stands still."""
        ...

    @property
    def drift(self) -> float:
        """Return the drift of the device's clock, s/s; positive if it is fast."""
        ...

    def capture_ns(self, device_ns: int, arrival_ns: int) -> int:
        """Return the host time of capture, ns, from the device's clock, and the host's on arrival."""
        ...


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
    """Host time of capture, as far as the device's clock shows it; else that of the reading."""
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

        # Names, and the problem of the newest items
        self._label = label
        self._plugin = plugin
        self._check = ReadingCheck()
        self._problem = ""

        # The device's clock
        self._clock: CaptureClock | None = None
        if has_steady_time:
            for device_clock in present((CLOCK,)):
                self._clock = device_clock()
        self._has_device_time = False
        self._age_ns = 0
        """Largest age of a reading on arrival since the last report, by the device's clock."""
        self._jumps = 0
        self._jump_shown_s = 0.0

        # The filter, loaded by the first raw reading
        self._fusion: RawFusion | None = None
        self._no_fusion = ""
        """Reason why raw readings cannot be used, or `""`."""

    def process_item(self, item: Item, now_ns: int, now_s: float) -> SensorSample | None:
        """Process `item`. Return its orientation, or None without one, or if it cannot be used.

        Args:
            item: as delivered. A `Press` is only checked: see `is_refused`.
            now_ns: the host's clock.
            now_s: the monotonic time.
        """
        # A wrong item is refused, but for the state of the connection
        problem = self._check.problem(item, now_ns)
        self.has_changed = problem != self._problem
        self._problem = problem
        is_link_event = isinstance(item, Reconnected | Disconnected)
        if self._check.is_refused and not is_link_event:
            return None
        if isinstance(item, Reading):
            return self._process_reading(item, now_s)
        if isinstance(item, RawReading):
            return self._process_raw_reading(item, now_s)

        # Only readings have an orientation. All else may change a warning.
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

    def _process_reading(self, reading: Reading, now_s: float) -> SensorSample:
        self.newest = reading.world_from_sensor
        self.monitor.on_reading(reading.world_from_sensor, now_s)
        stamp_ns, device_ns = self._capture_times(reading)
        return SensorSample(stamp_ns, reading.world_from_sensor, device_ns)

    def _process_raw_reading(self, reading: RawReading, now_s: float) -> SensorSample | None:
        self.monitor.on_reading((*reading.angular_velocity_radps, *reading.acceleration_mps2), now_s)
        stamp_ns, device_ns = self._capture_times(reading)
        if device_ns != reading.device_time_ns:
            reading = replace(reading, device_time_ns=device_ns)
        orientation = self._fuse(reading)
        if orientation is None:
            return None
        self.newest = orientation
        return SensorSample(stamp_ns, orientation, device_ns)

    @property
    def is_refused(self) -> bool:
        """Return True if the last item must not be used."""
        return self._check.is_refused

    def report(self, now_s: float) -> Iterator[Figure]:
        """Yield the metrics; to be called about once a second."""
        drift_ppm: int | None = None
        age_ms: int | None = None
        clock = self._clock
        if clock is not None and clock.is_used and self._has_device_time:
            drift_ppm = round(1e6 * clock.drift)
            age_ms = round(self._age_ns / 1e6)
        self._age_ns = 0
        figures: list[Figure] = [*self.monitor.report(now_s)]
        figures += [("clock drift", drift_ppm, "ppm"), ("age", age_ms, "ms")]
        if self._fusion is not None:
            figures += self._fusion.report(now_s)
        return iter(figures)

    def warnings(self, now_s: float, *, is_explained: bool) -> Iterator[WarningText]:
        """Yield the warnings. `is_explained`: the source itself reports why nothing comes."""
        problem = f"{self._plugin} {self._problem}" if self._problem else ""
        yield "readings", problem
        fusion_problem = f"{self._plugin} {self._no_fusion}" if self._no_fusion else ""
        yield "fusion", fusion_problem
        yield "device-clock", self._clock_warning(now_s)
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

    def _capture_times(self, reading: Reading | RawReading) -> tuple[int, int | None]:
        """Return the time of capture, and the device's without wraps or None if it has none that runs, ns."""
        stamp_ns = reading.stamp_ns
        clock = self._clock

        # A clock that stands still or jumps is followed, to notice when it runs, but not published.
        if clock is not None and not clock.is_used and reading.device_time_ns is not None:
            return clock.capture_ns(reading.device_time_ns, stamp_ns), None

        # Unwrap the device's time. That also detects a restart, so it is done without a clock, too.
        epoch_before = self.epoch.count
        device_ns = self.epoch.read(reading.device_time_ns)
        if device_ns is None or clock is None:
            return stamp_ns, device_ns

        self._has_device_time = True
        if self.epoch.count != epoch_before:
            clock.restart_fallen(stamp_ns)
        capture_ns = clock.capture_ns(device_ns, stamp_ns)
        self._age_ns = max(self._age_ns, stamp_ns - capture_ns)
        if not clock.is_used:  # since this reading
            return capture_ns, None
        return capture_ns, device_ns

    def _fuse(self, reading: RawReading) -> Quaternion | None:
        """Return the orientation by the filter, which is loaded for the first raw reading."""
        if self._fusion is None and not self._no_fusion:
            try:
                self._fusion = load_object(FUSION, "sends raw readings, whose fusion")()
            except ConfigError as error:
                self._no_fusion = str(error)
        fusion = self._fusion
        if fusion is None:
            return None
        restarts_before = fusion.restarts
        orientation = fusion.update(reading)
        if fusion.restarts != restarts_before:
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
            self._jumps = clock.jumps
            self._jump_shown_s = now_s
        if not clock.jumps or now_s - self._jump_shown_s > SHOWN_S:
            return ""
        return f"the clock of {self._label} jumped by {clock.jump_s:+.1f} s, or this machine's was set"
