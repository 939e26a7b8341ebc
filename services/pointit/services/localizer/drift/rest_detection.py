"""The drift of an IMU, measured while the arm rests: whatever a resting arm seems to turn by is drift.

To be fed only while no cursor is shown: people steer a cursor onto the target, so that their arm turns in
the room against the drift and stands still for the IMU (pointing.md §3), which would be measured as none.

Only turning about the vertical drifts, gravity holds the rest; so the vertical part of the rotation from
sample to sample is summed up, which is well defined with the arm hanging down too, where an azimuth is not.
A slow horizontal movement at an even rate below `max_rate_radps` cannot be told from drift.
"""

import math
from collections import deque
from dataclasses import dataclass

from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S


@dataclass(frozen=True, kw_only=True)
class StillnessSettings:
    """What counts as rest, and how people hold still (pointing.md §7)."""

    shortest_s: float = 2.0
    """Shorter rests tell nothing."""
    longest_s: float = 10.0
    """A rest this long is measured, and a new one begun."""
    settle_s: float = 0.5
    """So much after a movement and before the next one is not rest."""
    bin_s: float = 0.1
    """Samples are averaged over so much."""
    gap_s: float = 0.5
    """A longer silence ends the rest."""
    max_step_rad: float = math.radians(1.5)
    """Turning by more within `settle_s` is movement."""
    max_rate_radps: float = math.radians(1.0)
    """Turning faster, all the time, is following something: no IMU drifts so fast."""
    max_spread_rad: float = math.radians(0.75)
    """Wander about an even rate, rms, above which the arm does not rest."""
    hold_sigma_rad: float = math.radians(0.25)
    """How a held arm wanders sideways, rms."""
    tilt_sigma_rad: float = math.radians(0.16)
    """How it wanders up and down, rms."""
    correlation_s: float = 0.3
    """For how long that wander is alike."""
    turn_sigma_radps: float = math.radians(0.03)
    """What a resting body itself turns by; no rest is measured better."""
    creep_sigma_radps: float = math.radians(0.2)
    """What an arm that is held up creeps by, always the same way for one person: holds told the drift to
    5.3° in 45 s (pointing.md §3)."""
    hanging_rad: float = math.radians(-50.0)
    """Elevation of the arm below which it hangs and does not creep."""
    gate: float = 3.0
    """Tilting at a rate of more than so many sigmas is movement."""


@dataclass(frozen=True, kw_only=True)
class RestYawRate:
    """What one rest told; goes to `DriftFilter.update_rest_rate` as it is."""

    stamp_ns: int
    """The middle of the rest."""
    yaw_rate_radps: float
    """Of {H} in {W}: minus the rate at which the resting arm turned in {H}."""
    sigma_radps: float
    """Of this rest by itself."""
    creep_sigma_radps: float
    """Of what all rests of a held-up arm have in common; 0 when it hung."""
    span_s: float


_Turn = tuple[int, float, float, float]
"""Time in ns; turned by then about x, y, z of {H}, averaged over a bin."""


class RestDetector:
    """Finds rests in a stream of orientations; constant work a sample."""

    def __init__(self, settings: StillnessSettings | None = None) -> None:
        """Wait for a rest."""
        self._settings = settings if settings is not None else StillnessSettings()
        self._bin_ns = round(self._settings.bin_s * NS_PER_S)
        self._gap_ns = round(self._settings.gap_s * NS_PER_S)
        self._delay = max(1, round(self._settings.settle_s / self._settings.bin_s))
        self._last: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self._last_ns = -1
        self._tilt_x, self._tilt_y, self._yaw = 0.0, 0.0, 0.0
        """Turned since the rest began, about the axes of {H}."""
        self._count, self._sum_ns, self._bin_start_ns = 0, 0, 0
        self._sum_x, self._sum_y, self._sum_yaw = 0.0, 0.0, 0.0
        self._recent: deque[_Turn] = deque(maxlen=self._delay + 1)
        """What is not yet known to be rest, because a movement may just begin."""
        self._kept: list[_Turn] = []
        self._to_settle = self._delay

    def end(self) -> RestYawRate | None:
        """Return the rate if the rest until now tells one, and begin anew: as when a cursor appears."""
        told = self._finish()
        self._last_ns = -1
        self._begin()
        return told

    def add(self, orientation_xyzw: Quaternion, stamp_ns: int) -> RestYawRate | None:
        """Take a sample; return a rate when it ends a rest, or when the rest has lasted long enough.

        Args:
            orientation_xyzw: of the arm in {H}, norm 1.
            stamp_ns: of its measurement; a sample that is not newer than the last one is ignored, but a
                clock that was set back by more than `gap_s` begins a new rest.
        """
        passed_ns = stamp_ns - self._last_ns
        if self._last_ns < 0 or not -self._gap_ns <= passed_ns <= self._gap_ns:
            told = self._finish() if self._last_ns >= 0 and passed_ns > 0 else None
            self._begin()
            self._last, self._last_ns = orientation_xyzw, stamp_ns
            return told
        if passed_ns <= 0:
            return None
        # rotation vector of new ⊗ old⁻¹, in {H}; small, so twice its sine will do
        x, y, z, w = orientation_xyzw
        a, b, c, d = self._last
        twice = 2.0 if w * d + x * a + y * b + z * c >= 0.0 else -2.0
        self._tilt_x += twice * (d * x - a * w - y * c + z * b)
        self._tilt_y += twice * (d * y - b * w - z * a + x * c)
        self._yaw += twice * (d * z - c * w - x * b + y * a)
        self._last, self._last_ns = orientation_xyzw, stamp_ns
        if stamp_ns - self._bin_start_ns < self._bin_ns and self._count:
            self._count += 1
            self._sum_ns += stamp_ns - self._bin_start_ns
            self._sum_x += self._tilt_x
            self._sum_y += self._tilt_y
            self._sum_yaw += self._yaw
            return None
        told = self._close() if self._count else None
        self._bin_start_ns = stamp_ns
        self._count, self._sum_ns = 1, 0
        self._sum_x, self._sum_y, self._sum_yaw = self._tilt_x, self._tilt_y, self._yaw
        return told

    def _begin(self) -> None:
        """Begin a new rest, which must settle first."""
        self._tilt_x = self._tilt_y = self._yaw = 0.0
        self._count = self._sum_ns = self._bin_start_ns = 0
        self._sum_x = self._sum_y = self._sum_yaw = 0.0
        self._recent.clear()
        self._kept.clear()
        self._to_settle = self._delay

    def _close(self) -> RestYawRate | None:
        """Take the bin that is full."""
        n = self._count
        newest = (
            self._bin_start_ns + self._sum_ns // n,
            self._sum_x / n,
            self._sum_y / n,
            self._sum_yaw / n,
        )
        recent = self._recent
        recent.append(newest)
        oldest = recent[0]
        if (
            math.hypot(newest[1] - oldest[1], newest[2] - oldest[2], newest[3] - oldest[3])
            > self._settings.max_step_rad
        ):
            told = self._finish()
            self._begin()
            return told
        if self._to_settle > 0:
            self._to_settle -= 1
            return None
        self._kept.append(oldest)
        if oldest[0] - self._kept[0][0] < self._settings.longest_s * NS_PER_S:
            return None
        told = self._finish()
        self._kept.clear()
        return told

    def _finish(self) -> RestYawRate | None:
        """Return what the rest told, if it was one."""
        settings, kept = self._settings, self._kept
        if len(kept) < 3:
            return None
        start_ns = kept[0][0]
        span_s = (kept[-1][0] - start_ns) / NS_PER_S
        if span_s < settings.shortest_s:
            return None
        times = [(one[0] - start_ns) / NS_PER_S for one in kept]
        rates, spreads = zip(*(_line(times, [one[axis] for one in kept]) for axis in (1, 2, 3)), strict=True)
        share = math.sqrt(24.0 * settings.correlation_s / span_s) / span_s
        """Of a rate's sigma in the rms of a correlated wander: least squares over `span_s`."""
        tilting = settings.gate * share
        if (
            abs(rates[2]) > settings.max_rate_radps
            or max(spreads) > settings.max_spread_rad
            or math.hypot(rates[0], rates[1]) > tilting * max(settings.tilt_sigma_rad, spreads[0], spreads[1])
        ):
            return None
        sigma = share * max(settings.hold_sigma_rad, spreads[2])
        x, y, z, w = self._last
        hangs = 2.0 * (x * z - w * y) < math.sin(settings.hanging_rad)  # height of the arm's x axis
        return RestYawRate(
            stamp_ns=start_ns + round(span_s / 2 * NS_PER_S),
            yaw_rate_radps=-rates[2],
            sigma_radps=math.hypot(sigma, settings.turn_sigma_radps),
            creep_sigma_radps=0.0 if hangs else settings.creep_sigma_radps,
            span_s=span_s,
        )


def _line(times: list[float], values: list[float]) -> tuple[float, float]:
    """Return slope and rms about the straight line through `values`."""
    n = len(times)
    mean_t, mean_v = sum(times) / n, sum(values) / n
    tt = sum((t - mean_t) ** 2 for t in times)
    tv = sum((t - mean_t) * (v - mean_v) for t, v in zip(times, values, strict=True))
    vv = sum((v - mean_v) ** 2 for v in values)
    slope = tv / tt
    return slope, math.sqrt(max(0.0, vv - slope * tv) / n)
