"""IMU drift measured while the arm rests: any apparent turn of a resting arm is drift.

Use it only while no cursor is shown. People steer a cursor onto the target, so that their arm turns in the
room against the drift and stands still for the IMU (pointing.md §3), which would measure as zero drift.

Drift only turns about the vertical, since gravity fixes the other axes. The vertical part of the rotation
from sample to sample is summed, which is well defined for a hanging arm, too, unlike an azimuth.
A slow horizontal movement at a constant rate below `MAX_RATE_RADPS` cannot be distinguished from drift.
"""

import math
from collections import deque
from dataclasses import dataclass

from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S

# Criteria of rest, and noise of people who hold still (pointing.md §7)

_Turn = tuple[int, float, float, float]
"""Time (ns) and turn up to it about x, y, z of {H}, averaged over a bin."""

SHORTEST_S = 2.0
"""Shorter rests are ignored."""
LONGEST_S = 10.0
"""Length of a rest after which it is measured and a new one starts."""
SETTLE_S = 0.5
"""Time after a movement and before the next one that is not rest."""
BIN_S = 0.1
"""Length of the bins over which samples are averaged."""
GAP_S = 0.5
"""A longer silence ends the rest."""
MAX_STEP_RAD = math.radians(1.5)
"""Smallest turn within `SETTLE_S` that is movement."""
MAX_RATE_RADPS = math.radians(1.0)
"""Fastest drift of an IMU: a constant turn beyond it means that the arm follows something."""
MAX_SPREAD_RAD = math.radians(0.75)
"""Largest rms about a constant rate at which the arm rests."""
HOLD_SIGMA_RAD = math.radians(0.25)
"""Sideways tremor of a held arm, rms."""
TILT_SIGMA_RAD = math.radians(0.16)
"""Vertical tremor of a held arm, rms."""
CORRELATION_S = 0.3
"""Correlation time of the tremor."""
TURN_SIGMA_RADPS = math.radians(0.03)
"""Standard deviation of a resting body's turn, a lower bound for each rest."""
RAISED_SIGMA_RADPS = math.radians(0.18)
"""Standard deviation of the turn of a raised arm between rests, besides its constant creep."""
HANGING_RAD = math.radians(-50.0)
"""Elevation below which the arm hangs and does not creep."""
GATE = 3.0
"""Number of standard deviations of the tilt rate beyond which the arm moves."""


@dataclass(frozen=True, kw_only=True)
class RestYawRate:
    """Yaw rate of one rest, as in the arguments of `DriftFilter.update_rest_rate`."""

    stamp_ns: int
    """Middle of the rest."""
    yaw_rate_radps: float
    """Yaw rate of {H} in {W}: minus the rate at which the resting arm turned in {H}."""
    sigma_radps: float
    """Standard deviation of this rest alone."""
    is_raised: bool
    """True unless the arm hangs: a raised arm creeps."""
    span_s: float


class RestDetector:
    """Finds rests in a stream of orientations, in constant time per sample."""

    def __init__(self) -> None:
        self._bin_ns = round(BIN_S * NS_PER_S)
        self._gap_ns = round(GAP_S * NS_PER_S)
        self._delay = max(1, round(SETTLE_S / BIN_S))
        self._last: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self._last_ns = -1
        self._tilt_x = 0.0
        """Turn since the rest began about x of {H}; the next two are about y and z."""
        self._tilt_y = 0.0
        self._yaw = 0.0
        self._count = 0
        self._sum_ns = 0
        self._bin_start_ns = 0
        self._sum_x = 0.0
        self._sum_y = 0.0
        self._sum_yaw = 0.0
        self._recent: deque[_Turn] = deque(maxlen=self._delay + 1)
        """Bins that may belong to the beginning of a movement."""
        self._turns: list[_Turn] = []
        self._to_settle = self._delay

    def end(self) -> RestYawRate | None:
        """End the rest, as when a cursor appears. Return its rate, or None if it was too short."""
        rate = self._finish()
        self._last_ns = -1
        self._begin()
        return rate

    def add(self, orientation_xyzw: Quaternion, stamp_ns: int) -> RestYawRate | None:
        """Add a sample. Return a rate if it ends a rest or the rest is long enough.

        Args:
            orientation_xyzw: of the arm in {H}, norm 1.
            stamp_ns: of its measurement. A sample that is not newer than the last one is ignored, but a clock
                step back by more than `GAP_S` starts a new rest.
        """
        passed_ns = stamp_ns - self._last_ns
        is_first = self._last_ns < 0
        if is_first or not -self._gap_ns <= passed_ns <= self._gap_ns:
            # A gap ends the rest before it. After a clock step back its times are of no use.
            rate = None
            if not is_first and passed_ns > 0:
                rate = self._finish()
            self._begin()
            self._last = orientation_xyzw
            self._last_ns = stamp_ns
            return rate
        if passed_ns <= 0:
            return None

        # Rotation vector of new ⊗ old⁻¹ in {H}. It is small, so twice the sine approximates it. q and -q are
        # the same orientation: the sign of the dot product chooses the shorter rotation.
        x, y, z, w = orientation_xyzw
        a, b, c, d = self._last
        dot = w * d + x * a + y * b + z * c
        twice = 2.0 if dot >= 0.0 else -2.0
        turn_x = d * x - a * w - y * c + z * b
        turn_y = d * y - b * w - z * a + x * c
        turn_z = d * z - c * w - x * b + y * a
        self._tilt_x += twice * turn_x
        self._tilt_y += twice * turn_y
        self._yaw += twice * turn_z
        self._last = orientation_xyzw
        self._last_ns = stamp_ns

        # The sample belongs to the present bin, or ends it and begins the next one
        if stamp_ns - self._bin_start_ns < self._bin_ns and self._count:
            self._count += 1
            self._sum_ns += stamp_ns - self._bin_start_ns
            self._sum_x += self._tilt_x
            self._sum_y += self._tilt_y
            self._sum_yaw += self._yaw
            return None
        rate = self._close() if self._count else None
        self._bin_start_ns = stamp_ns
        self._count = 1
        self._sum_ns = 0
        self._sum_x = self._tilt_x
        self._sum_y = self._tilt_y
        self._sum_yaw = self._yaw
        return rate

    def _begin(self) -> None:
        self._tilt_x = self._tilt_y = self._yaw = 0.0
        self._count = self._sum_ns = self._bin_start_ns = 0
        self._sum_x = self._sum_y = self._sum_yaw = 0.0
        self._recent.clear()
        self._turns.clear()
        self._to_settle = self._delay

    def _close(self) -> RestYawRate | None:
        """Process the present bin. Return a rate if it ends a rest or makes one long enough."""
        count = self._count
        bin_ns = self._bin_start_ns + self._sum_ns // count
        newest = (bin_ns, self._sum_x / count, self._sum_y / count, self._sum_yaw / count)
        recent = self._recent
        recent.append(newest)
        oldest = recent[0]

        # A movement ends the rest. Bins reach `_turns` after `SETTLE_S`, so that its beginning is left out.
        step_rad = math.hypot(newest[1] - oldest[1], newest[2] - oldest[2], newest[3] - oldest[3])
        if step_rad > MAX_STEP_RAD:
            rate = self._finish()
            self._begin()
            return rate
        if self._to_settle > 0:
            self._to_settle -= 1
            return None

        # A long rest is measured in parts
        self._turns.append(oldest)
        if oldest[0] - self._turns[0][0] < LONGEST_S * NS_PER_S:
            return None
        rate = self._finish()
        self._turns.clear()
        return rate

    def _finish(self) -> RestYawRate | None:
        """Return the rate of the bins in `turns`, or None if they are too few or the arm moved."""
        turns = self._turns
        if len(turns) < 3:
            return None
        start_ns = turns[0][0]
        span_s = (turns[-1][0] - start_ns) / NS_PER_S
        if span_s < SHORTEST_S:
            return None

        # Rate about each axis, by a straight line
        times_s = [(turn[0] - start_ns) / NS_PER_S for turn in turns]
        tilt_x_rate, tilt_x_spread = _fit_line(times_s, [turn[1] for turn in turns])
        tilt_y_rate, tilt_y_spread = _fit_line(times_s, [turn[2] for turn in turns])
        yaw_rate, yaw_spread = _fit_line(times_s, [turn[3] for turn in turns])

        # Standard deviation of the rate per rms of a correlated wander: least squares over `span_s`
        rate_share = math.sqrt(24.0 * CORRELATION_S / span_s) / span_s

        # Drift neither tilts the arm nor is as fast as this
        if abs(yaw_rate) > MAX_RATE_RADPS:
            return None
        if max(tilt_x_spread, tilt_y_spread, yaw_spread) > MAX_SPREAD_RAD:
            return None
        max_tilt_rate = GATE * rate_share * max(TILT_SIGMA_RAD, tilt_x_spread, tilt_y_spread)
        if math.hypot(tilt_x_rate, tilt_y_rate) > max_tilt_rate:
            return None

        wander_sigma = rate_share * max(HOLD_SIGMA_RAD, yaw_spread)
        x, y, z, w = self._last
        x_axis_height = 2.0 * (x * z - w * y)  # of the arm
        is_raised = x_axis_height >= math.sin(HANGING_RAD)
        turn_sigma = RAISED_SIGMA_RADPS if is_raised else TURN_SIGMA_RADPS
        return RestYawRate(
            stamp_ns=start_ns + round(span_s / 2 * NS_PER_S),
            yaw_rate_radps=-yaw_rate,
            sigma_radps=math.hypot(wander_sigma, turn_sigma),
            is_raised=is_raised,
            span_s=span_s,
        )


def _fit_line(times: list[float], values: list[float]) -> tuple[float, float]:
    """Return slope and rms about the straight line through `values`."""
    n = len(times)
    mean_t = math.fsum(times) / n
    mean_v = math.fsum(values) / n
    time_offsets = [t - mean_t for t in times]
    value_offsets = [v - mean_v for v in values]
    tt = math.fsum(t**2 for t in time_offsets)
    tv = math.fsum(t * v for t, v in zip(time_offsets, value_offsets, strict=True))
    vv = math.fsum(v**2 for v in value_offsets)
    slope = tv / tt
    return slope, math.sqrt(max(0.0, vv - slope * tv) / n)
