"""State of the drift filter at one time: x, y, yaw, yaw rate and their covariance."""

import copy
import math
from typing import NamedTuple

import numpy as np

from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.model import (
    RATE,
    YAW,
    AnchorMeasurement,
    Array,
    DriftPose,
    DriftSettings,
    Fix,
    X,
    Y,
)


class Innovation(NamedTuple):
    """A pointing compared with what the state predicts: azimuth and elevation, rad."""

    value: Array
    """2: measured minus expected."""
    slope: Array
    """2 x 4, derivatives of the measurement by the state."""
    noise: Array
    """2: variances of pointing."""
    variances: Array
    """2: variances of `value`."""


class DriftState:
    """Predicts, applies measurements and fixes, and can be made uncertain. It does not reject anything."""

    def __init__(self, fix: Fix, settings: DriftSettings) -> None:
        """Start at `fix` with an IMU of unknown drift."""
        self._settings = settings
        self.mean = np.array([fix.x_m, fix.y_m, math.remainder(fix.yaw_rad, math.tau), 0.0])
        self.covariance = np.zeros((4, 4))
        self.covariance[:3, :3] = nearest_psd(fix.covariance)
        self.covariance[RATE, RATE] = settings.rate_sigma_radps**2
        self.stamp_ns = fix.stamp_ns
        self._bound()

    @property
    def is_yaw_unknown(self) -> bool:
        """Return True if the yaw is too uncertain to be used."""
        return float(self.covariance[YAW, YAW]) >= self._blank_variance

    @property
    def rate_sigma_radps(self) -> float:
        """Return the standard deviation of the yaw rate."""
        return math.sqrt(max(0.0, float(self.covariance[RATE, RATE])))

    def late_s(self, stamp_ns: int) -> float:
        """Return the age of a measurement at `stamp_ns` relative to the state, s; at least 0."""
        return max(0, self.stamp_ns - stamp_ns) / NS_PER_S

    def at(self, now_ns: int, anchored_ns: int) -> DriftPose:
        """Return the pose at `now_ns` or the last measurement, whichever is later; the state stays."""
        mean, covariance = self._predicted(max(0, now_ns - self.stamp_ns) / NS_PER_S)
        return DriftPose(
            x_m=float(mean[X]),
            y_m=float(mean[Y]),
            yaw_rad=float(mean[YAW]),
            covariance=covariance[:3, :3].copy(),
            yaw_rate_radps=float(mean[RATE]),
            yaw_rate_sigma_radps=math.sqrt(max(0.0, float(covariance[RATE, RATE]))),
            anchored_ns=anchored_ns,
            stamp_ns=max(now_ns, self.stamp_ns),
        )

    def advance(self, stamp_ns: int) -> None:
        """Advance to `stamp_ns` if that is later."""
        if stamp_ns > self.stamp_ns:
            self.mean, self.covariance = self._predicted((stamp_ns - self.stamp_ns) / NS_PER_S)
            self.stamp_ns = stamp_ns

    def innovation(self, sight: AnchorMeasurement) -> Innovation:
        """Return the comparison of `sight`, which may be older than the state, with the state."""
        settings, late_s = self._settings, self.late_s(sight.stamp_ns)
        mean = self.mean.copy()
        mean[YAW] -= late_s * mean[RATE]
        expected, slope, _ = predicted_bearing(mean, sight)
        slope[:, RATE] = -late_s * slope[:, YAW]
        value = np.array(
            [
                math.remainder(sight.azimuth_rad - float(expected[0]), math.tau),
                sight.elevation_rad - float(expected[1]),
            ]
        )
        level = math.cos(sight.elevation_rad)
        noise = np.array(
            [
                (settings.anchor_sigma_rad**2 + sight.spread_rad**2) / level**2,
                settings.elevation_sigma_rad**2 + sight.spread_rad**2,
            ]
        )
        return Innovation(value, slope, noise, np.diag(slope @ self.covariance @ slope.T) + noise)

    def apply(self, seen: Innovation) -> None:
        """Apply a pointing."""
        self.update(seen.value, seen.slope, np.diag(seen.noise))

    def update(self, innovation: Array, slope: Array, noise: Array) -> None:
        """Apply a measurement (Joseph form: stays symmetric and positive).

        Args:
            innovation: n, measured minus expected.
            slope: n x 4, derivatives of the measurement by the state.
            noise: n x n.
        """
        covariance = self.covariance
        total = slope @ covariance @ slope.T + noise
        gain = np.linalg.solve(total, slope @ covariance).T
        keep = np.eye(4) - gain @ slope
        self.mean = self.mean + gain @ innovation
        self.covariance = keep @ covariance @ keep.T + gain @ noise @ gain.T
        self._bound()

    def move_to(self, fix: Fix, *, keeps_yaw: bool, keeps_rate: bool) -> bool:
        """Apply a new localization and discard the old position. Return False if the yaws contradict.

        A fix that is older than the state is advanced to its time with the known rate. If its yaw and the old
        one fit within the gate, both are fused, which measures the rate, too, with the correlation from the
        rate that they share. If they do not fit, the old yaw is dropped and the rate is uncertain again.

        Args:
            fix: the new pose.
            keeps_yaw: True to use the old yaw; otherwise the rate stays as it was.
            keeps_rate: True to start from the old rate, rather than 0, if the yaws do not fit.
        """
        settings = self._settings
        self.advance(fix.stamp_ns)
        late_s = self.late_s(fix.stamp_ns)
        rate, rate_variance = float(self.mean[RATE]), float(self.covariance[RATE, RATE])
        mean, covariance = self._brought(fix, rate, rate_variance, late_s)
        fits = True
        if keeps_yaw and not self.is_yaw_unknown:
            yaw, shared = float(self.mean[YAW]), float(self.covariance[YAW, RATE])
            joint = np.zeros((5, 5))
            """Joint covariance of the fix, advanced to now with the rate, and the old yaw."""
            joint[:4, :4] = covariance
            joint[4, 4] = self.covariance[YAW, YAW]
            joint[4, YAW] = joint[YAW, 4] = late_s * shared
            joint[4, RATE] = joint[RATE, 4] = shared
            apart = np.array([0.0, 0.0, 1.0, 0.0, -1.0])
            both = joint @ apart
            total = float(apart @ both)
            away = math.remainder(yaw - float(mean[YAW]), math.tau)
            if total > 0.0 and abs(away) <= settings.gate * math.sqrt(total):
                mean = mean + both[:4] / total * away
                keep = np.eye(5) - np.outer(both / total, apart)
                covariance = (keep @ joint @ keep.T)[:4, :4]  # not by a difference, so that it stays positive
            else:
                fits = False
                rate = rate if keeps_rate else 0.0
                mean, covariance = self._brought(fix, rate, settings.rate_sigma_radps**2, late_s)
        self.mean, self.covariance = mean, covariance
        self._bound()
        return fits

    def inflate_covariance(self, yaw_variance: float, position_variance: float) -> None:
        """Make the parts of the pose less certain independently, and reset the rate's uncertainty."""
        covariance = self.covariance
        covariance[YAW, :2] = covariance[:2, YAW] = 0.0
        covariance[YAW, YAW] += yaw_variance
        covariance[[X, Y], [X, Y]] += position_variance
        self.inflate_rate_variance(self._settings.rate_sigma_radps)

    def inflate_rate_variance(self, sigma_radps: float) -> None:
        """Set the standard deviation of the rate and drop its correlations."""
        self.covariance[RATE, :3] = self.covariance[:3, RATE] = 0.0
        self.covariance[RATE, RATE] = sigma_radps**2
        self._bound()

    def without_rate(self, since_ns: int) -> "DriftState":
        """Return the state as if the rate had been unknown since the yaw of `since_ns`."""
        other = copy.copy(self)
        passed_s = max(0, self.stamp_ns - since_ns) / NS_PER_S
        back = np.eye(4)
        back[YAW, RATE] = -passed_s
        other.mean, other.covariance = back @ self.mean, back @ self.covariance @ back.T
        other.covariance[YAW, YAW] += (passed_s * self._settings.rate_sigma_radps) ** 2
        other.reset_rate()
        return other

    def reset_yaw(self) -> None:
        """Make the yaw unknown; position and rate stay."""
        covariance = self.covariance
        blank = max(self._blank_variance, float(covariance[YAW, YAW]))
        covariance[YAW, :] = covariance[:, YAW] = 0.0
        covariance[YAW, YAW] = blank

    def reset_rate(self) -> None:
        """Reset the rate to that of an unknown IMU."""
        self.mean[RATE] = 0.0
        self.inflate_rate_variance(self._settings.rate_sigma_radps)

    @property
    def _blank_variance(self) -> float:
        return (0.5 * self._settings.max_yaw_sigma_rad) ** 2

    def _brought(self, fix: Fix, rate: float, rate_variance: float, late_s: float) -> tuple[Array, Array]:
        """Return mean (4) and covariance (4 x 4) of `fix` and a rate, advanced by `late_s`.

        Not bounded: yaw and rate must stay consistent with the old yaw, which has the same rate.
        """
        mean = np.array([fix.x_m, fix.y_m, math.remainder(fix.yaw_rad, math.tau), rate])
        covariance = np.zeros((4, 4))
        covariance[:3, :3] = bounded(nearest_psd(fix.covariance), self._settings)
        covariance[RATE, RATE] = rate_variance
        return _propagated(mean, covariance, late_s, self._settings)

    def _predicted(self, passed_s: float) -> tuple[Array, Array]:
        mean, covariance = _propagated(self.mean, self.covariance, passed_s, self._settings)
        return mean, bounded(covariance, self._settings) if passed_s > 0.0 else covariance

    def _bound(self) -> None:
        limit = self._settings.max_rate_radps
        self.mean[YAW] = math.remainder(float(self.mean[YAW]), math.tau)
        self.mean[RATE] = min(max(float(self.mean[RATE]), -limit), limit)
        self.covariance = bounded(self.covariance, self._settings)


def predicted_bearing(mean: Array, sight: AnchorMeasurement) -> tuple[Array, Array, float]:
    """Return the bearing of the target from the person's eyes.

    Args:
        mean: 4: x, y (m), yaw (rad) of {H} in {W}; the rest is ignored.
        sight: target and origin of the ray.

    Returns:
        azimuth and elevation in {H} (2), their derivatives by the state (2 x 4), horizontal distance (m).
    """
    cos_yaw, sin_yaw = math.cos(mean[2]), math.sin(mean[2])
    eye_x = cos_yaw * sight.origin_m[0] - sin_yaw * sight.origin_m[1]
    eye_y = sin_yaw * sight.origin_m[0] + cos_yaw * sight.origin_m[1]
    east = sight.target_m[0] - float(mean[0]) - eye_x
    north = sight.target_m[1] - float(mean[1]) - eye_y
    up = sight.target_m[2] - sight.origin_m[2]
    away = max(math.hypot(east, north), 1e-9)
    square = away * away
    azimuth = math.remainder(math.atan2(north, east) - float(mean[2]), math.tau)
    lower = -up / (square + up * up)
    slope = np.zeros((2, 4))
    slope[0, :3] = north / square, -east / square, -1.0 - (east * eye_x + north * eye_y) / square
    slope[1, :3] = (
        -lower * east / away,
        -lower * north / away,
        lower * (east * eye_y - north * eye_x) / away,
    )
    return np.array([azimuth, math.atan2(up, away)]), slope, away


def _propagated(
    mean: Array, covariance: Array, passed_s: float, settings: DriftSettings
) -> tuple[Array, Array]:
    """Return copies of mean (4) and covariance (4 x 4) advanced by `passed_s`, not bounded."""
    mean = mean.copy()
    if passed_s <= 0.0:
        return mean, covariance.copy()
    mean[YAW] = math.remainder(float(mean[YAW] + mean[RATE] * passed_s), math.tau)
    step = np.eye(4)
    step[YAW, RATE] = passed_s
    covariance = step @ covariance @ step.T
    walk = settings.rate_walk_radps**2 * passed_s
    covariance[[X, Y], [X, Y]] += settings.position_walk_m**2 * passed_s
    covariance[YAW, YAW] += settings.yaw_walk_rad**2 * passed_s + walk * passed_s**2 / 3.0
    covariance[YAW, RATE] += walk * passed_s / 2.0
    covariance[RATE, YAW] += walk * passed_s / 2.0
    covariance[RATE, RATE] += walk
    return mean, covariance


def bounded(covariance: Array, settings: DriftSettings) -> Array:
    """Return `covariance` (3 x 3 of x, y, yaw, or 4 x 4 with the rate) symmetric and within the bounds.

    Correlations stay.
    """
    away = settings.max_position_sigma_m
    largest = np.array([away, away, settings.max_yaw_sigma_rad, settings.max_rate_radps])
    largest = largest[: len(covariance)]
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    shrink = np.minimum(1.0, largest / sigmas)
    return np.asarray(0.5 * (covariance + covariance.T) * np.outer(shrink, shrink))


def nearest_psd(covariance: Array) -> Array:
    """Return the nearest symmetric positive semidefinite 3 x 3 matrix.

    Raises:
        ValueError: If it is not 3 x 3 or not finite.
    """
    square = np.asarray(covariance, dtype=np.float64)
    if square.shape != (3, 3) or not np.all(np.isfinite(square)):
        raise ValueError("the covariance of a pose must be 3 x 3 and finite")
    values, axes = np.linalg.eigh(0.5 * (square + square.T))
    return np.asarray((axes * np.maximum(values, 0.0)) @ axes.T)
