"""Where {H} is in {W} while the IMU's yaw drifts: an extended Kalman filter on x, y, yaw and the yaw's rate.

What the person does with a visible cursor tells nothing: they steer it onto the target, whatever the drift.
What tells: pointing at a known place without one (`update_anchor`), pointing in a known direction
(`update_heading`), an arm that rests (`update_rest_rate`), and a new localization (`reset`).
Pointing.md §3, §4.
"""

import math
from dataclasses import replace

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift import innovation_gate
from pointit.services.localizer.drift.anchor_measurement import (
    AnchorMeasurement,
    innovation_terms,
    rejection_reason,
)
from pointit.services.localizer.drift.innovation_gate import AGREED, DRIFTED, Rejected
from pointit.services.localizer.drift.model import (
    RATE,
    YAW,
    AnchorResult,
    Array,
    DriftPose,
    DriftSettings,
    Fix,
)
from pointit.services.localizer.drift.state import DriftState

__all__ = ["AnchorResult", "DriftFilter", "DriftPose", "DriftSettings", "Fix"]

RATE_FORGOTTEN = "the yaw does not change at the rate that was believed, which is forgotten"
"""Note of an anchor that contradicts the rate alone."""

LEAST_SIGMA = 1e-6
"""Nothing is measured better (rad, rad/s)."""


class DriftFilter:
    """Knows the pose between localizations, and how sure that is."""

    def __init__(self, fix: Fix, settings: DriftSettings | None = None) -> None:
        """Start at `fix` with an IMU of which nothing is known."""
        self._settings = settings if settings is not None else DriftSettings()
        self._state = DriftState(fix, self._settings)
        self._anchored_ns = 0
        self._fixed_ns = 0
        self._agreed = 0
        """How many yaws in a row fit one rate."""
        self._agreed_ns = 0
        """Time of the newest of them."""
        self._other: tuple[DriftState, int, int] | None = None
        """State, `_agreed` and `_agreed_ns` as they are if the anchor against the rate is an outlier."""
        self._rejected: list[Rejected] = []
        self._took(fix, fits=False)

    @property
    def settings(self) -> DriftSettings:
        """Return what it was made with."""
        return self._settings

    def set_time(self, now_ns: int | None) -> None:
        """Take the time: a clock that was set back is followed, as far as it is beyond late measurements.

        Every other entry takes the time, too, and does this first; without it a clock that was set back looks
        like a measurement that is too late.

        Args:
            now_ns: none: not known.
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
        """Take a new localization.

        The person may have walked anywhere, so the old position is forgotten. The yaw of {H} is the IMU's
        yaw origin and does not change by walking: where the new yaw fits the predicted one within the gate,
        both are fused, which tells the rate as well. Where it does not, the new one is taken as it is and the
        rate counts as unknown again, and is forgotten unless it was confirmed. Where the rays of both fixes
        overlap in time, the new one replaces the old one and the rate is kept: the same rays never count
        twice.

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
        """Take that the IMU's yaw origin is another one from `stamp_ns` on: only the yaw is unknown.

        Args:
            stamp_ns: when.
            is_restarted: the device was restarted, so that its drift is unknown, too.
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
        """Go on to `now_ns` and return the pose there; a clock that was set back is followed."""
        self.set_time(now_ns)
        self._state.advance(now_ns)
        return self.at(now_ns)

    def at(self, now_ns: int) -> DriftPose:
        """Return the pose at `now_ns`, or at the last prediction if that is later; changes nothing."""
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
        """Take one pointing at a known place without a cursor.

        Rejected when it is beyond the gate, unless only an unconfirmed rate puts it there: that rate may come
        from a jump, so it is forgotten and the anchor is taken, until the next one tells which of the two was
        wrong. When `believe_after` in a row are rejected and agree, the IMU was turned or the person moved:
        then they are believed. When `despair_after` in a row contradict each other, the pose becomes
        uncertain and the reason asks for a new localization.

        Args:
            stamp_ns: the middle of the hold; the filter goes on to it where it is newer.
            target_m: {W}.
            origin_m: of the ray, {H}.
            direction_h: mean of the unfiltered rays, the person's offset taken out, {H}; any length but 0.
            elevation_bias_rad: of the pose: the rays lie higher than the targets by it.
            spread_rad: rms of the rays about their mean.
            samples: rays in the mean.
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
        wrong = self._untimely(stamp_ns) or rejection_reason(
            self._state.mean, sight, direction_h, samples, self._settings
        )
        if wrong:
            return AnchorResult(accepted=False, reason=wrong)
        self._state.advance(stamp_ns)
        self._decide(sight)
        innovation, slope, noise = self._sighted(sight)
        azimuth, elevation = -float(innovation[0]), -float(innovation[1])
        allowed = self._settings.gate * np.sqrt(np.diag(slope @ self._state.covariance @ slope.T) + noise)
        if np.all(np.abs(innovation) <= allowed):
            self._rejected.clear()
            self._state.update(innovation, slope, np.diag(noise))
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
        return self._doubted(Rejected(sight, azimuth, elevation, float(noise[0]), float(noise[1])), allowed)

    def update_heading(
        self,
        stamp_ns: int,
        azimuth_w_rad: float,
        direction_h: Vec3,
        sigma_rad: float = math.radians(3.0),
        *,
        now_ns: int | None = None,
    ) -> AnchorResult:
        """Take that the person points in a known direction: "face the wall and press".

        Somebody says so on purpose, so there is no gate: beyond it the yaw is set anew.

        Args:
            stamp_ns: when.
            azimuth_w_rad: of that direction, {W}.
            direction_h: of the ray, the person's offset taken out, {H}; any length but 0.
            sigma_rad: how exactly people do that, > 0.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        settings = self._settings
        wrong = self._untimely(stamp_ns)
        if not wrong and abs(vector.elevation(direction_h)) > settings.max_elevation_rad:
            wrong = "the arm points too steeply to tell a direction; point level at the wall"
        if not wrong and not (math.isfinite(azimuth_w_rad) and 0.0 < sigma_rad < math.inf):
            wrong = "the direction is no finite angle; give the wall's azimuth in degrees"
        if wrong:
            return AnchorResult(accepted=False, reason=wrong)
        self._state.advance(stamp_ns)
        late_s = self._state.late_s(stamp_ns)
        slope = np.array([[0.0, 0.0, 1.0, -late_s]])
        yaw = azimuth_w_rad - vector.azimuth(direction_h)
        self._other = None
        away = math.remainder(yaw - float(self._state.mean[YAW] - late_s * self._state.mean[RATE]), math.tau)
        noise = max(sigma_rad, LEAST_SIGMA) ** 2
        note = ""
        if away**2 > settings.gate**2 * (float((slope @ self._state.covariance @ slope.T)[0, 0]) + noise):
            note = f"the yaw was off by {math.degrees(away):+.0f}° and was set anew"
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
        """Take the yaw rate that was measured while the arm rested; see `stillness.StillRate`.

        What creeps cannot be averaged out, so it is taken only while the rate is known less well than that.

        Args:
            stamp_ns: the middle of the rest; up to a minute old, since rates change slowly.
            yaw_rate_radps: of {H} in {W}: minus the rate at which the IMU turned.
            sigma_radps: its one sigma, > 0.
            creep_sigma_radps: one sigma of an error that all such rests of this person share.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        settings = self._settings
        sigma = max(math.hypot(sigma_radps, creep_sigma_radps), LEAST_SIGMA)
        usable = math.isfinite(yaw_rate_radps) and math.isfinite(sigma)
        if not usable or abs(yaw_rate_radps) > settings.max_rate_radps + settings.gate * sigma:
            return AnchorResult(accepted=False, reason="the arm turned faster than any IMU drifts; rest it")
        if stamp_ns < self._state.stamp_ns - 60 * NS_PER_S:
            return AnchorResult(accepted=False, reason="the rest is over since long; see the clocks")
        self._state.advance(stamp_ns)
        away = yaw_rate_radps - float(self._state.mean[RATE])
        variance = float(self._state.covariance[RATE, RATE])
        if variance <= creep_sigma_radps**2:
            return AnchorResult(
                accepted=False, reason="a held-up arm does not tell the drift better; let it hang"
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
        """Count a yaw at `stamp_ns` that fits the ones before, or that contradicts them and `is_first`."""
        if is_first or not self._agreed:
            self._agreed, self._agreed_ns = 1, stamp_ns
        elif stamp_ns - self._agreed_ns >= self._settings.confirming_s * NS_PER_S:
            self._agreed, self._agreed_ns = self._agreed + 1, stamp_ns

    def _contradict_rate(self) -> None:
        """Forget the rate unless it was confirmed: an IMU that is turned drifts as before."""
        if not self._is_confirmed:
            self._state.reset_rate()
            self._agreed = 0

    def _fits_without_rate(self, sight: AnchorMeasurement) -> bool:
        """Update the state with `sight` and without the rate, where it fits so. Return True if it does."""
        state = self._state.without_rate(self._agreed_ns)
        innovation, slope, noise = innovation_terms(
            state.mean, sight, state.late_s(sight.stamp_ns), self._settings
        )
        variances = np.diag(slope @ state.covariance @ slope.T) + noise
        if np.any(innovation**2 > self._settings.gate**2 * variances):
            return False
        state.update(innovation, slope, np.diag(noise))
        self._other = (self._state, self._agreed, self._agreed_ns)
        self._state = state
        return True

    def _decide(self, sight: AnchorMeasurement) -> None:
        """Return to the state without the anchor against the rate, where `sight` is likelier there."""
        if self._other is None:
            return
        state, agreed, agreed_ns = self._other
        self._other = None
        state.advance(self._state.stamp_ns)
        if _unlikeliness(state, sight, self._settings) < _unlikeliness(self._state, sight, self._settings):
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
        return f"the pointing is {late_s:.0f} s old; see the IMU's radio and the clocks, and point again"

    def _sighted(self, sight: AnchorMeasurement) -> tuple[Array, Array, Array]:
        """Return innovation (2), slope (2 x 4) and variances (2) of azimuth and elevation."""
        return innovation_terms(self._state.mean, sight, self._state.late_s(sight.stamp_ns), self._settings)

    def _doubted(self, doubt: Rejected, allowed: Array) -> AnchorResult:
        """Return what becomes of an anchor beyond the gate."""
        settings = self._settings
        self._rejected.append(doubt)
        verdict = innovation_gate.judge_rejected(
            self._rejected,
            settings.gate,
            self._state.rate_sigma_radps,
            since_ns=self._anchored_ns,
            believe_after=settings.accept_after,
            despair_after=settings.reset_after,
        )
        result = AnchorResult(
            accepted=False,
            azimuth_error_rad=doubt.azimuth_error_rad,
            elevation_error_rad=doubt.elevation_error_rad,
            reason=innovation_gate.sentence(doubt, allowed, verdict),
        )
        if verdict in {AGREED, DRIFTED}:
            believed = self._rejected[-settings.accept_after :]
            self._rejected.clear()
            if verdict == AGREED:
                self._state.inflate_covariance(doubt.azimuth_error_rad**2, settings.moved_sigma_m**2)
                self._contradict_rate()
            else:
                self._state.inflate_rate_variance(settings.max_rate_radps)
            for one in believed:
                innovation, slope, noise = self._sighted(one.sight)
                self._state.update(innovation, slope, np.diag(noise))
            self._anchored_ns = max(self._anchored_ns, doubt.sight.stamp_ns)
            return replace(result, accepted=True, reason="", note=result.reason)
        if verdict:
            self._rejected.clear()
            self._state.inflate_covariance(settings.turned_sigma_rad**2, settings.moved_sigma_m**2)
        return result


def _unlikeliness(state: DriftState, sight: AnchorMeasurement, settings: DriftSettings) -> float:
    """Return minus twice the logarithm of the likelihood of `sight`, but for a constant."""
    innovation, slope, noise = innovation_terms(state.mean, sight, state.late_s(sight.stamp_ns), settings)
    variances = np.diag(slope @ state.covariance @ slope.T) + noise
    return float(np.sum(innovation**2 / variances + np.log(variances)))
