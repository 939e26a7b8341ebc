"""Orientation from angular velocity and acceleration, by VQF without magnetometer (extra `fusion`).

An error of the sample period by 1 % costs 10° and more in a turning arm, so it is never taken from the
distance of two arrivals: it comes from the device's clock, or from a regression of many arrivals over the
number of samples. The filter has a fixed period. Its rates are scaled to the measured one, so that it need
not be rebuilt as the estimate improves.

Laidig & Seel, "VQF: Highly accurate IMU orientation estimation with bias estimation and magnetic disturbance
rejection", Information Fusion 91, 2023.
"""

import math
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any, Protocol

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.device_wrist import Figure, Values
from pointit.services.imu_bridge.sources import RawReading

"""Angular velocity and acceleration."""
START_S = 1.0
"""Duration of the first readings, from which the filter gets its period, s."""
MIN_START = 10
"""Number of readings that this takes at least."""
MIN_PERIOD_S = 1.0 / 2000.0
"""Shortest period that is believed, s: it limits the work for which a device can ask by its times."""
MAX_GAP_S = 1.0
"""Longest gap over which the last angular velocity is assumed to go on, s. After a longer one the filter is
restarted with its bias, and the yaw has a new origin."""
MEMORY_S = 120.0
"""Time constant of the regression of arrivals, s."""
STILL_RADPS = math.radians(0.3)
STILL_MPS2 = 0.1
"""Standard deviations of each axis below which the first readings are of a device that lies still."""
MAX_UNCERTAINTY_DEGPS = 0.3
"""Standard deviation of the bias above which the device must be laid down, °/s. It is 0.5 at the start, below
0.1 after a rest of 3 s, and 0.14 two minutes later."""
MAX_CHANGE = 0.2
"""Relative change of the period beyond which the filter is restarted."""


class Vqf(Protocol):
    """The part of `vqf.VQF` that is used; the package has no types."""

    def update(self, gyr: Array, acc: Array) -> None:
        """Process one sample, rad/s and m/s²."""
        ...

    def getQuat6D(self) -> Array:  # noqa: N802
        """Return the orientation w, x, y, z."""
        ...

    def getBiasEstimate(self) -> tuple[Array, float]:  # noqa: N802
        """Return the bias of the gyroscope and its standard deviation, rad/s."""
        ...

    def getRestDetected(self) -> bool:  # noqa: N802
        """Return True if the device lies still."""
        ...

    def setBiasEstimate(self, bias: Array) -> None:  # noqa: N802
        """Set the bias, rad/s."""
        ...


class PeriodRegression:
    """Sample period from arrivals: the slope of a line through them over their number, with forgetting."""

    def __init__(self) -> None:
        self._first_ns: int | None = None
        self._number = 0
        self._weight = self._mean_x = self._mean_y = self._var_x = self._cov = 0.0
        self.span_s = 0.0
        """Time since the first arrival, s."""

    @property
    def count(self) -> int:
        """Return the number of arrivals."""
        return self._number

    @property
    def period_s(self) -> float | None:
        """Return the sample period, s, or None if it is not known yet."""
        if self._var_x > 0.0 and self._cov > 0.0:
            return self._cov / self._var_x
        return None

    def add(self, arrival_ns: int) -> None:
        """Add the arrival of the next sample."""
        if self._first_ns is None:
            self._first_ns = arrival_ns
        x = float(self._number)
        y = (arrival_ns - self._first_ns) / NS_PER_S
        keep = math.exp(-max(y - self.span_s, 0.0) / MEMORY_S)
        self._number += 1
        self.span_s = y
        weight = self._weight * keep + 1.0
        dx = x - self._mean_x
        dy = y - self._mean_y
        share = self._weight * keep / weight
        self._mean_x += dx / weight
        self._mean_y += dy / weight
        self._var_x = keep * self._var_x + share * dx * dx
        self._cov = keep * self._cov + share * dx * dy
        self._weight = weight


class Fusion:
    """Computes the orientation of one sensor."""

    def __init__(self) -> None:
        """Load the filter.

        Raises:
            ConfigError: If the extra is not installed.
        """
        try:
            module: Any = import_module("vqf")
        except ImportError as error:
            raise ConfigError(
                f"sends angular velocities and accelerations, which need an extra: run {remedy('fusion')}"
            ) from error
        self._make: Callable[[float], Vqf] = module.VQF
        self._gyr = np.zeros(3)
        self._acc = np.zeros(3)
        self._vqf: Vqf | None = None

        # Bias of the gyroscope, which outlives a restart
        self._offset: Vec3 = (0.0, 0.0, 0.0)
        """Angular velocity of the device at rest at the start, rad/s. That of cheap gyroscopes exceeds the
        2 °/s that the filter accepts as a bias."""
        self._bias: Array | None = None
        """Bias of the gyroscope before the last restart, rad/s."""
        self.uncertainty_degps = math.inf
        """Standard deviation of the bias, °/s."""

        # Drift of the heading, which a rest reveals
        self._moving_bias: Array | None = None
        """Bias when the device was last moved, rad/s."""
        self.measured_degps = math.inf
        """Drift of the heading before the last rest, °/s."""
        self._rested_s: float | None = None
        """Time of the last rest, s."""
        self.restarts = 0
        """Number of restarts after the first start: each has another yaw origin."""
        self._reset_readings()

    def _reset_readings(self) -> None:
        self._period_s = 0.0
        self._filter_period_s = 0.0
        self._arrival_regression = PeriodRegression()
        self._before_ns: int | None = None
        self._held_back: list[tuple[Values, float]] = []

    def restart(self) -> None:
        """Start again with the bias: readings were lost, or the device was moved without them."""
        if self._vqf is not None:
            self._bias = self._vqf.getBiasEstimate()[0]
            self._vqf = None
            self.restarts += 1
        self._reset_readings()

    def update(self, reading: RawReading) -> Quaternion | None:
        """Return the orientation, or None in the first second and for a repeated reading."""
        step_s = self._step_s(reading)
        if step_s > MAX_GAP_S:
            self.restart()
            self._step_s(reading)
            return None
        if step_s <= 0.0:
            return None
        vqf = self._vqf
        values = (*reading.angular_velocity_radps, *reading.acceleration_mps2)
        if vqf is None:
            self._held_back.append((values, step_s))
            if self._arrival_regression.span_s < START_S or self._arrival_regression.count < MIN_START:
                return None
            vqf = self._start_filter()
        else:
            self._update_filter(vqf, values, step_s)
        qw, qx, qy, qz = vqf.getQuat6D().tolist()
        return (qx, qy, qz, qw)

    def _update_filter(self, vqf: "Vqf", values: Values, step_s: float) -> None:
        steps = max(1, round(step_s / self._period_s))
        scale = step_s / (steps * self._filter_period_s)
        gyr = self._gyr
        acc = self._acc
        ox, oy, oz = self._offset
        gyr[0] = (values[0] - ox) * scale
        gyr[1] = (values[1] - oy) * scale
        gyr[2] = (values[2] - oz) * scale
        acc[:] = values[3:]
        for _ in range(steps):
            vqf.update(gyr, acc)

    def report(self, now_s: float) -> Iterator[Figure]:
        """Yield metrics; to be called about once a second.

        The change of the bias during a rest is the rate at which the heading drifted before it.
        """
        vqf = self._vqf
        if vqf is None:
            yield "resting", None, ""
            yield "heading drift rate", None, "°/min"
            yield "heading drift", None, "°"
            return

        # Update what is known of the bias
        is_resting = vqf.getRestDetected()
        bias, sigma = vqf.getBiasEstimate()
        self.uncertainty_degps = math.degrees(sigma)
        if not is_resting:
            self._moving_bias = bias
        else:
            self._rested_s = now_s
            if self._moving_bias is not None:
                change_radps = float(np.linalg.norm(bias - self._moving_bias))
                self.measured_degps = math.degrees(change_radps)

        # Drift since the last rest, when the filter last saw the bias alone
        rate_degps = min(self.uncertainty_degps, self.measured_degps)
        drift_deg: float | None = None
        if self._rested_s is not None and rate_degps:
            since_s = now_s - self._rested_s
            drift_deg = round(since_s * rate_degps, 1)
        yield "resting", float(is_resting), ""
        yield "heading drift rate", round(60.0 * rate_degps, 1), "°/min"
        yield "heading drift", drift_deg, "°"

    def warning(self, label: str) -> str:
        """Return a message if the bias of the gyroscope is not known yet, else `""`."""
        if self._vqf is None or self.uncertainty_degps < MAX_UNCERTAINTY_DEGPS:
            return ""
        return (
            f"the heading of {label} drifts by up to {60.0 * self.uncertainty_degps:.0f}°/min, since it "
            "never lay still: lay it down, or hold it still on a table, for 3 s"
        )

    def _start_filter(self) -> "Vqf":
        self._filter_period_s = self._period_s
        vqf = self._vqf = self._make(self._period_s)
        values = np.array([held_back for held_back, _ in self._held_back])

        # At rest the gyroscope measures its bias. Else that of the previous filter is the best estimate.
        spread = values.std(0)
        if spread[:3].max() < STILL_RADPS and spread[3:].max() < STILL_MPS2:
            x, y, z = values[:, :3].mean(0).tolist()
            self._offset = (x, y, z)
        elif self._bias is not None:
            vqf.setBiasEstimate(self._bias)

        # Make up for the readings of the first second
        for held_back, step_s in self._held_back:
            self._update_filter(vqf, held_back, step_s)
        self._held_back.clear()
        return vqf

    def _step_s(self, reading: RawReading) -> float:
        """Return the time since the last reading, s. 0: nothing is to be done with this one."""
        arrivals = self._arrival_regression
        device_ns = reading.device_time_ns
        time_ns = reading.stamp_ns if device_ns is None else device_ns
        previous_ns = self._before_ns
        self._before_ns = time_ns
        if previous_ns is None:
            arrivals.add(time_ns)
            return 0.0

        # A repeated or late reading is skipped. Arrivals may coincide, the device's times do not.
        step_s = (time_ns - previous_ns) / NS_PER_S
        if device_ns is not None and step_s <= 0.0:
            if step_s < -MAX_GAP_S:
                return math.inf  # its clock was set: nothing is known of the time between
            self._before_ns = previous_ns
            return 0.0
        if step_s > MAX_GAP_S:
            return step_s

        # Follow the period. The filter has it fixed, so another one needs a new filter.
        arrivals.add(time_ns)
        period_s = arrivals.period_s
        if period_s is None:
            return 0.0
        if self._vqf is not None:
            change = abs(period_s / self._filter_period_s - 1.0)
            if change > MAX_CHANGE:
                return math.inf
        if period_s < MIN_PERIOD_S:
            return 0.0 if arrivals.span_s < START_S else math.inf
        self._period_s = period_s
        return period_s if device_ns is None else step_s
