"""The state of the drift filter: x, y, yaw, yaw rate and how sure they are, at one time."""

import copy
import math

import numpy as np

from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.model import (
    RATE,
    YAW,
    Array,
    DriftPose,
    DriftSettings,
    Fix,
    X,
    Y,
    bounded,
    nearest_psd,
    predicted,
    propagate_unbounded,
)


class DriftState:
    """Goes on with time, takes measurements and fixes, and can be doubted; judges nothing."""

    def __init__(self, fix: Fix, settings: DriftSettings) -> None:
        """Start at `fix` with an IMU of which nothing is known."""
        self._settings = settings
        self.mean = np.array([fix.x_m, fix.y_m, math.remainder(fix.yaw_rad, math.tau), 0.0])
        self.covariance = np.zeros((4, 4))
        self.covariance[:3, :3] = nearest_psd(fix.covariance)
        self.covariance[RATE, RATE] = settings.rate_sigma_radps**2
        self.stamp_ns = fix.stamp_ns
        self._bound()

    @property
    def is_yaw_unknown(self) -> bool:
        """Return True if the yaw is so uncertain that it says nothing."""
        return float(self.covariance[YAW, YAW]) >= self._blank_variance

    @property
    def rate_sigma_radps(self) -> float:
        """Return one sigma of the yaw's rate."""
        return math.sqrt(max(0.0, float(self.covariance[RATE, RATE])))

    def late_s(self, stamp_ns: int) -> float:
        """Return by how much what was measured at `stamp_ns` is older than the state, s; at least 0."""
        return max(0, self.stamp_ns - stamp_ns) / NS_PER_S

    def at(self, now_ns: int, anchored_ns: int) -> DriftPose:
        """Return the pose at `now_ns`, or at the last measurement if that is later; changes nothing."""
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
        """Go on to `stamp_ns`, where that is later."""
        if stamp_ns > self.stamp_ns:
            self.mean, self.covariance = self._predicted((stamp_ns - self.stamp_ns) / NS_PER_S)
            self.stamp_ns = stamp_ns

    def update(self, innovation: Array, slope: Array, noise: Array) -> None:
        """Take a measurement (Joseph's form: stays symmetric and positive).

        Args:
            innovation: n, measured less expected.
            slope: n x 4, of what is measured by the state.
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
        """Take a new localization; the old position is forgotten. Return False if the yaws contradict.

        A fix that is older than the state goes on to its time as the filter itself does, with the rate that
        is known. Where its yaw and the old one fit within the gate, both are fused, which tells the rate too;
        both of them know the same rate, so what they have in common is taken into account. Where they do not
        fit, the old yaw is dropped and the rate counts as unknown again.

        Args:
            fix: the new pose.
            keeps_yaw: whether the old yaw counts; without it the rate stays as it was.
            keeps_rate: whether the old rate is where to begin from when the yaws do not fit, rather than 0.
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
            """Of the fix brought to now with the rate, and of the old yaw."""
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
                covariance = (keep @ joint @ keep.T)[:4, :4]  # as it is, not by a difference: stays positive
            else:
                fits = False
                rate = rate if keeps_rate else 0.0
                mean, covariance = self._brought(fix, rate, settings.rate_sigma_radps**2, late_s)
        self.mean, self.covariance = mean, covariance
        self._bound()
        return fits

    def inflate_covariance(self, yaw_variance: float, position_variance: float) -> None:
        """Make the pose less certain, its parts for themselves, and forget what is known of the rate."""
        covariance = self.covariance
        covariance[YAW, :2] = covariance[:2, YAW] = 0.0
        covariance[YAW, YAW] += yaw_variance
        covariance[[X, Y], [X, Y]] += position_variance
        self.inflate_rate_variance(self._settings.rate_sigma_radps)

    def inflate_rate_variance(self, sigma_radps: float) -> None:
        """Believe the rate only so far."""
        self.covariance[RATE, :3] = self.covariance[:3, RATE] = 0.0
        self.covariance[RATE, RATE] = sigma_radps**2
        self._bound()

    def without_rate(self, since_ns: int) -> "DriftState":
        """Return the state as if nothing had been known of the rate since the yaw of `since_ns`."""
        other = copy.copy(self)
        passed_s = max(0, self.stamp_ns - since_ns) / NS_PER_S
        back = np.eye(4)
        back[YAW, RATE] = -passed_s
        other.mean, other.covariance = back @ self.mean, back @ self.covariance @ back.T
        other.covariance[YAW, YAW] += (passed_s * self._settings.rate_sigma_radps) ** 2
        other.reset_rate()
        return other

    def reset_yaw(self) -> None:
        """Make the yaw unknown; place and rate stay."""
        covariance = self.covariance
        blank = max(self._blank_variance, float(covariance[YAW, YAW]))
        covariance[YAW, :] = covariance[:, YAW] = 0.0
        covariance[YAW, YAW] = blank

    def reset_rate(self) -> None:
        """Take another IMU, of which nothing is known."""
        self.mean[RATE] = 0.0
        self.inflate_rate_variance(self._settings.rate_sigma_radps)

    @property
    def _blank_variance(self) -> float:
        return (0.5 * self._settings.max_yaw_sigma_rad) ** 2

    def _brought(self, fix: Fix, rate: float, rate_variance: float, late_s: float) -> tuple[Array, Array]:
        """Return mean (4) and covariance (4 x 4) of `fix` and a rate, brought `late_s` on.

        Not bounded after that, or yaw and rate would not fit the old yaw any more, which has the same rate.
        """
        mean = np.array([fix.x_m, fix.y_m, math.remainder(fix.yaw_rad, math.tau), rate])
        covariance = np.zeros((4, 4))
        covariance[:3, :3] = bounded(nearest_psd(fix.covariance), self._settings)
        covariance[RATE, RATE] = rate_variance
        return propagate_unbounded(mean, covariance, late_s, self._settings)

    def _predicted(self, passed_s: float) -> tuple[Array, Array]:
        return predicted(self.mean, self.covariance, passed_s, self._settings)

    def _bound(self) -> None:
        limit = self._settings.max_rate_radps
        self.mean[YAW] = math.remainder(float(self.mean[YAW]), math.tau)
        self.mean[RATE] = min(max(float(self.mean[RATE]), -limit), limit)
        self.covariance = bounded(self.covariance, self._settings)
