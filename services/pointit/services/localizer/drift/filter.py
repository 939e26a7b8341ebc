"""Pose of {H} in {W} while the IMU's yaw drifts: an extended Kalman filter on x, y, yaw and yaw rate.

Pointing with a visible cursor gives no information: people steer the cursor onto the target, whatever the
drift. Measurements are pointing at a known place without a cursor (`update_anchor`), pointing in a known
direction (`update_heading`), an arm at rest (`update_rest_rate`) and a new localization (`reset`).
Pointing.md §3, §4.
"""

import math
from dataclasses import replace

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift import innovation_gate
from pointit.services.localizer.drift.innovation_gate import AGREED, DRIFTED, Rejected
from pointit.services.localizer.drift.model import (
    RATE,
    YAW,
    AnchorMeasurement,
    AnchorResult,
    Array,
    DriftPose,
    DriftSettings,
    Fix,
)
from pointit.services.localizer.drift.state import DriftState, Innovation, predicted_bearing

__all__ = ["AnchorResult", "DriftFilter", "DriftPose", "DriftSettings", "Fix"]

RATE_FORGOTTEN = "the yaw does not change at the estimated rate, which is discarded"
"""Note of an anchor that contradicts only the rate."""

LEAST_SIGMA = 1e-6
"""Lower bound of measurement noise (rad, rad/s)."""

NEAREST_M = 0.2
"""Smallest horizontal distance from the eyes to a target."""


class DriftFilter:
    """Tracks the pose and its covariance between localizations."""

    def __init__(self, fix: Fix, settings: DriftSettings | None = None) -> None:
        """Start at `fix` with an IMU of unknown drift."""
        self._settings = settings if settings is not None else DriftSettings()
        self._state = DriftState(fix, self._settings)
        self._anchored_ns = 0
        self._fixed_ns = 0
        self._agreed = 0
        """Number of consecutive yaws that fit one rate."""
        self._agreed_ns = 0
        """Time of the newest of them."""
        self._other: tuple[DriftState, int, int] | None = None
        """State, `_agreed` and `_agreed_ns` in case the anchor against the rate is an outlier."""
        self._rejected: list[Rejected] = []
        self._took(fix, fits=False)

    def set_time(self, now_ns: int | None) -> None:
        """Set the time. A clock step back beyond the age limit of measurements moves the state back, too.

        The other methods do this first with their own time. Without it a measurement after a clock step back
        looks too old.

        Args:
            now_ns: None if not known.
        """
        if now_ns is None or not self._is_set_back(now_ns):
            return
        self._state.stamp_ns = now_ns
        self._other = None
        self._anchored_ns = min(self._anchored_ns, now_ns)
        self._fixed_ns = min(self._fixed_ns, now_ns)
        self._agreed_ns = min(self._agreed_ns, now_ns)
        self._rejected.clear()

    def reset(self, fix: Fix, *, now_ns: int | None = None) -> None:
        """Apply a new localization.

        The person may have walked anywhere, so the old position is discarded. The yaw of {H} is the IMU's yaw
        origin and does not change by walking: if the new yaw fits the predicted one within the gate, both are
        fused, which measures the rate as well. Otherwise the new yaw replaces the old one and the rate is
        uncertain again, starting from 0 unless it was confirmed. If the rays of both fixes overlap in time,
        the new fix replaces the old one and the rate is kept, so that the same rays never count twice.

        Args:
            fix: the new pose; its stamp may lie before the last prediction.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        since_ns = fix.since_ns if fix.since_ns is not None else fix.stamp_ns
        is_new = since_ns > self._fixed_ns
        fits = self._state.move_to(fix, keeps_yaw=is_new, keeps_rate=self._is_confirmed)
        self._took(fix, fits=fits and is_new)

    def reset_yaw(self, stamp_ns: int, *, is_restarted: bool) -> None:
        """Make the yaw unknown because the IMU's yaw origin changes at `stamp_ns`.

        Args:
            stamp_ns: time of the change.
            is_restarted: True if the device was restarted, which makes its drift unknown, too.
        """
        self.set_time(stamp_ns)
        self._state.advance(stamp_ns)
        self._state.reset_yaw()
        self._other = None
        if is_restarted:
            self._state.reset_rate()
            self._agreed = 0
        self._rejected.clear()

    def predict(self, now_ns: int) -> DriftPose:
        """Advance to `now_ns` and return the pose. The filter follows a clock step back."""
        self.set_time(now_ns)
        self._state.advance(now_ns)
        return self.at(now_ns)

    def at(self, now_ns: int) -> DriftPose:
        """Return the pose at `now_ns` or the last prediction, whichever is later; the state stays."""
        return self._state.at(now_ns, self._anchored_ns)

    def update_anchor(
        self,
        stamp_ns: int,
        target_m: Vec3,
        origin_m: Vec3,
        direction_h: Vec3,
        *,
        elevation_bias_rad: float = 0.0,
        spread_rad: float = 0.0,
        samples: int = 1,
        now_ns: int | None = None,
    ) -> AnchorResult:
        """Apply one pointing at a known place without a cursor.

        Rejected if it is beyond the gate, unless only an unconfirmed rate puts it there: that rate may come
        from a jump, so it is discarded and the anchor is accepted until the next one shows which of the two
        was wrong. If `accept_after` consecutive rejected anchors agree, the IMU was turned or the person
        moved, and they are accepted. If `reset_after` in a row contradict each other, the pose becomes
        uncertain and the reason asks for a new localization.

        Args:
            stamp_ns: middle of the hold; the filter advances to it if it is newer.
            target_m: {W}.
            origin_m: of the ray, {H}.
            direction_h: mean of the unfiltered rays without the person's offset, {H}; any length but 0.
            elevation_bias_rad: of the pose: the angle by which rays lie above the targets.
            spread_rad: rms of the rays about their mean.
            samples: number of rays in the mean.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        sight = AnchorMeasurement(
            stamp_ns=stamp_ns,
            target_m=(target_m[0], target_m[1], target_m[2] - self._floor_m),
            origin_m=origin_m,
            azimuth_rad=vector.azimuth(direction_h),
            elevation_rad=vector.elevation(direction_h) - elevation_bias_rad,
            spread_rad=spread_rad,
        )
        rejection = self._untimely(stamp_ns) or self._unusable(sight, direction_h, samples)
        if rejection:
            return AnchorResult(accepted=False, reason=rejection)
        self._state.advance(stamp_ns)
        self._decide(sight)
        seen = self._state.innovation(sight)
        azimuth, elevation = -float(seen.value[0]), -float(seen.value[1])
        allowed = self._settings.gate * np.sqrt(seen.variances)
        if np.all(np.abs(seen.value) <= allowed):
            self._rejected.clear()
            self._state.apply(seen)
            self._anchored_ns = max(self._anchored_ns, stamp_ns)
            self._agree(stamp_ns)
            return AnchorResult(accepted=True, azimuth_error_rad=azimuth, elevation_error_rad=elevation)
        if not self._is_confirmed and self._fits_without_rate(sight):
            self._rejected.clear()
            self._anchored_ns = max(self._anchored_ns, stamp_ns)
            self._agree(stamp_ns, is_first=True)
            return AnchorResult(
                accepted=True, azimuth_error_rad=azimuth, elevation_error_rad=elevation, note=RATE_FORGOTTEN
            )
        noise = seen.noise
        return self._on_outlier(
            Rejected(sight, azimuth, elevation, float(noise[0]), float(noise[1])), allowed
        )

    def update_heading(
        self,
        stamp_ns: int,
        azimuth_w_rad: float,
        direction_h: Vec3,
        sigma_rad: float = math.radians(3.0),
        *,
        now_ns: int | None = None,
    ) -> AnchorResult:
        """Apply pointing in a known direction: "face the wall and press".

        People do this on purpose, so there is no gate: beyond it the yaw is replaced.

        Args:
            stamp_ns: time of pointing.
            azimuth_w_rad: of that direction, {W}.
            direction_h: of the ray without the person's offset, {H}; any length but 0.
            sigma_rad: standard deviation of such pointing, > 0.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        settings = self._settings
        rejection = self._untimely(stamp_ns)
        if not rejection and abs(vector.elevation(direction_h)) > settings.max_elevation_rad:
            rejection = "the arm points too steeply for a direction; point level at the wall"
        if not rejection and not (math.isfinite(azimuth_w_rad) and 0.0 < sigma_rad < math.inf):
            rejection = "the direction is not a finite angle; give the wall's azimuth in degrees"
        if rejection:
            return AnchorResult(accepted=False, reason=rejection)
        self._state.advance(stamp_ns)
        late_s = self._state.late_s(stamp_ns)
        slope = np.array([[0.0, 0.0, 1.0, -late_s]])
        yaw = azimuth_w_rad - vector.azimuth(direction_h)
        self._other = None
        away = math.remainder(yaw - float(self._state.mean[YAW] - late_s * self._state.mean[RATE]), math.tau)
        noise = max(sigma_rad, LEAST_SIGMA) ** 2
        note = ""
        if away**2 > settings.gate**2 * (float((slope @ self._state.covariance @ slope.T)[0, 0]) + noise):
            note = f"the yaw was off by {math.degrees(away):+.0f}° and was replaced"
            self._state.inflate_covariance(away**2, 0.0)
            self._contradict_rate()
        self._state.update(np.array([away]), slope, np.array([[noise]]))
        self._rejected.clear()
        self._anchored_ns = max(self._anchored_ns, stamp_ns)
        self._agree(stamp_ns)
        return AnchorResult(accepted=True, azimuth_error_rad=away, note=note)

    def update_rest_rate(
        self,
        stamp_ns: int,
        yaw_rate_radps: float,
        sigma_radps: float,
        creep_sigma_radps: float = 0.0,
        *,
        now_ns: int | None = None,
    ) -> AnchorResult:
        """Apply the yaw rate of a resting arm; see `RestYawRate`.

        Creep does not average out, so the rate is used only while the known rate is less certain than creep.

        Args:
            stamp_ns: middle of the rest; up to a minute old, since rates change slowly.
            yaw_rate_radps: of {H} in {W}: minus the rate at which the IMU turned.
            sigma_radps: its standard deviation, > 0.
            creep_sigma_radps: standard deviation of an error that all such rests of this person share.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        settings = self._settings
        sigma = max(math.hypot(sigma_radps, creep_sigma_radps), LEAST_SIGMA)
        usable = math.isfinite(yaw_rate_radps) and math.isfinite(sigma)
        if not usable or abs(yaw_rate_radps) > settings.max_rate_radps + settings.gate * sigma:
            return AnchorResult(accepted=False, reason="the arm turned faster than any IMU drifts; rest it")
        if stamp_ns < self._state.stamp_ns - 60 * NS_PER_S:
            return AnchorResult(accepted=False, reason="the rest is more than a minute old; check the clocks")
        self._state.advance(stamp_ns)
        away = yaw_rate_radps - float(self._state.mean[RATE])
        variance = float(self._state.covariance[RATE, RATE])
        if variance <= creep_sigma_radps**2:
            return AnchorResult(
                accepted=False, reason="a raised arm does not measure the drift better; let it hang"
            )
        total = variance + sigma**2
        if away**2 > settings.gate**2 * total:
            return AnchorResult(
                accepted=False,
                reason=f"the resting arm turned {math.degrees(away) * 60:+.0f}° a minute beside the known "
                "drift; rest it on something that does not move",
            )
        self._state.update(np.array([away]), np.array([[0.0, 0.0, 0.0, 1.0]]), np.array([[sigma**2]]))
        return AnchorResult(accepted=True)

    def _is_set_back(self, now_ns: int) -> bool:
        return now_ns < self._state.stamp_ns - self._settings.max_late_s * NS_PER_S

    @property
    def _is_confirmed(self) -> bool:
        return self._agreed >= self._settings.confirmed_after

    def _agree(self, stamp_ns: int, *, is_first: bool = False) -> None:
        """Count a yaw at `stamp_ns` that fits the earlier ones, or start from 1 if `is_first`."""
        if is_first or not self._agreed:
            self._agreed, self._agreed_ns = 1, stamp_ns
        elif stamp_ns - self._agreed_ns >= self._settings.confirming_s * NS_PER_S:
            self._agreed, self._agreed_ns = self._agreed + 1, stamp_ns

    def _contradict_rate(self) -> None:
        """Discard the rate unless it is confirmed: an IMU that is turned drifts as before."""
        if not self._is_confirmed:
            self._state.reset_rate()
            self._agreed = 0

    def _fits_without_rate(self, sight: AnchorMeasurement) -> bool:
        """Update the state with `sight` but without the rate if it fits. Return True if it does."""
        state = self._state.without_rate(self._agreed_ns)
        seen = state.innovation(sight)
        if np.any(seen.value**2 > self._settings.gate**2 * seen.variances):
            return False
        state.apply(seen)
        self._other = (self._state, self._agreed, self._agreed_ns)
        self._state = state
        return True

    def _decide(self, sight: AnchorMeasurement) -> None:
        """Return to the state before the anchor against the rate if `sight` is likelier there."""
        if self._other is None:
            return
        state, agreed, agreed_ns = self._other
        self._other = None
        state.advance(self._state.stamp_ns)
        if _deviance(state.innovation(sight)) < _deviance(self._state.innovation(sight)):
            self._state, self._agreed, self._agreed_ns = state, agreed, agreed_ns

    def _took(self, fix: Fix, *, fits: bool) -> None:
        self._floor_m = fix.floor_m
        self._fixed_ns = fix.until_ns if fix.until_ns is not None else fix.stamp_ns
        self._agree(fix.stamp_ns, is_first=not fits)
        self._other = None
        self._rejected.clear()
        if fix.is_anchored:
            self._anchored_ns = fix.stamp_ns

    def _untimely(self, stamp_ns: int) -> str:
        late_s = self._state.late_s(stamp_ns)
        if late_s <= self._settings.max_late_s:
            return ""
        return f"the pointing is {late_s:.0f} s old; check the IMU's radio and the clocks, and point again"

    def _unusable(self, sight: AnchorMeasurement, direction_h: Vec3, samples: int) -> str:
        """Return the reason why a pointing cannot be used, or `""` if it can."""
        values = (*sight.target_m, *sight.origin_m, *direction_h, sight.elevation_rad, sight.spread_rad)
        if samples < 1 or not all(map(math.isfinite, values)) or vector.norm(direction_h) == 0.0:
            return "no usable ray came while the person pointed; see the IMU"
        if abs(sight.elevation_rad) > self._settings.max_elevation_rad:
            return "the target is too steeply above or below; choose one farther away"
        if predicted_bearing(self._state.mean, sight)[2] < NEAREST_M:
            return "the person would stand on the target; choose one farther away"
        return ""

    def _on_outlier(self, outlier: Rejected, allowed: Array) -> AnchorResult:
        """Return the result for an anchor beyond the gate: accepted if it agrees with the ones before."""
        settings = self._settings
        self._rejected.append(outlier)
        verdict = innovation_gate.judge_rejected(
            self._rejected,
            settings.gate,
            self._state.rate_sigma_radps,
            since_ns=self._anchored_ns,
            accept_after=settings.accept_after,
            reset_after=settings.reset_after,
        )
        result = AnchorResult(
            accepted=False,
            azimuth_error_rad=outlier.azimuth_error_rad,
            elevation_error_rad=outlier.elevation_error_rad,
            reason=innovation_gate.sentence(outlier, allowed, verdict),
        )
        if verdict in {AGREED, DRIFTED}:
            believed = self._rejected[-settings.accept_after :]
            self._rejected.clear()
            if verdict == AGREED:
                self._state.inflate_covariance(outlier.azimuth_error_rad**2, settings.moved_sigma_m**2)
                self._contradict_rate()
            else:
                self._state.inflate_rate_variance(settings.max_rate_radps)
            for accepted in believed:
                self._state.apply(self._state.innovation(accepted.sight))
            self._anchored_ns = max(self._anchored_ns, outlier.sight.stamp_ns)
            return replace(result, accepted=True, reason="", note=result.reason)
        if verdict:
            self._rejected.clear()
            self._state.inflate_covariance(settings.turned_sigma_rad**2, settings.moved_sigma_m**2)
        return result


def _deviance(seen: Innovation) -> float:
    """Return minus twice the logarithm of the likelihood of a pointing, but for a constant."""
    return float(np.sum(seen.value**2 / seen.variances + np.log(seen.variances)))
