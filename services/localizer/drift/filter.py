"""Pose of {H} in {W} while the IMU's yaw drifts: a Gaussian sum filter on x, y, yaw and yaw rate.

Pointing with a visible cursor gives no information: people steer the cursor onto the target, whatever the
drift. Measurements are pointing at a known place without a cursor (`update_anchor`), pointing in a known
direction (`update_heading`), an arm at rest (`update_rest_rate`) and a new localization (`reset`).
Pointing.md §3, §4.
"""

import math

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.state import (
    CREEP,
    RATE,
    YAW,
    AnchorMeasurement,
    AnchorResult,
    Case,
    DriftPose,
    DriftSettings,
    DriftState,
    Fix,
    Innovation,
    X,
    Y,
    bounded,
    nearest_psd,
)

NEAREST_M = 0.2
"""Smallest horizontal distance from the eyes to a target."""

ANYWHERE_M = 1e4
ANY_YAW_RAD = 10.0 * math.pi
"""Standard deviations of a position and of a yaw of which nothing is known."""

MAX_REST_AGE_S = 60.0
"""Age up to which rests count: rates change slowly."""


def innovation(means: Array, measurement: AnchorMeasurement, late_s: float) -> Innovation:
    """Return azimuth and elevation of a pointing, `late_s` old, minus those that each state expects."""
    then = means.copy()
    then[:, YAW] -= late_s * then[:, RATE]
    expected, slope, _ = predicted_bearing(then, measurement)
    slope[:, :, RATE] = -late_s * slope[:, :, YAW]
    value = np.array([measurement.azimuth_rad, measurement.elevation_rad]) - expected
    value[:, 0] = np.remainder(value[:, 0] + math.pi, math.tau) - math.pi
    return Innovation(value, slope)


def predicted_bearing(means: Array, measurement: AnchorMeasurement) -> tuple[Array, Array, Array]:
    """Return the bearing of the target from the person's eyes.

    Args:
        means: n x 5, states; only x, y (m) and yaw (rad) of {H} in {W} count.
        measurement: target and origin of the ray.

    Returns:
        azimuth and elevation in {H} (n x 2), their derivatives by the states (n x 2 x 5), horizontal
        distances (n), m.
    """
    yaw = means[:, YAW]
    cos_yaw = np.cos(yaw)
    sin_yaw = np.sin(yaw)
    eye_x = cos_yaw * measurement.origin_m[0] - sin_yaw * measurement.origin_m[1]
    eye_y = sin_yaw * measurement.origin_m[0] + cos_yaw * measurement.origin_m[1]
    east = measurement.target_m[0] - means[:, X] - eye_x
    north = measurement.target_m[1] - means[:, Y] - eye_y
    up = measurement.target_m[2] - measurement.origin_m[2]
    away = np.maximum(np.hypot(east, north), 1e-9)
    square = away * away
    lower = -up / (square + up * up)
    slope = np.zeros((len(means), 2, means.shape[1]))
    slope[:, 0, X] = north / square
    slope[:, 0, Y] = -east / square
    slope[:, 0, YAW] = -1.0 - (east * eye_x + north * eye_y) / square
    slope[:, 1, X] = -lower * east / away
    slope[:, 1, Y] = -lower * north / away
    slope[:, 1, YAW] = lower * (east * eye_y - north * eye_x) / away
    return np.stack([np.arctan2(north, east) - yaw, np.arctan2(up, away)], axis=1), slope, away


class DriftFilter:
    """Tracks the pose and its covariance between localizations."""

    def __init__(self, fix: Fix, settings: DriftSettings | None = None) -> None:
        """Start at `fix` with an IMU of unknown drift."""
        self._settings = settings if settings is not None else DriftSettings()
        self._state = DriftState(fix, self._settings)
        self._anchored_ns = 0
        self._fixed_ns = 0
        self._rested_ns = 0
        """Time of the newest rest that was accepted, or 0."""
        self._contradiction: tuple[int, float, float] | None = None
        """Time, yaw rate and its sigma of the last rest, if that was beside the known drift."""
        self._took(fix)

    def set_time(self, now_ns: int | None) -> None:
        """Set the time. A clock step back beyond the age limit of measurements moves the state back, too.

        The other methods do this first with their own time. Without it a measurement after a clock step back
        looks too old.

        Args:
            now_ns: None if not known.
        """
        if now_ns is None or now_ns >= self._state.stamp_ns - self._settings.max_late_s * NS_PER_S:
            return
        self._state.stamp_ns = now_ns
        self._anchored_ns = min(self._anchored_ns, now_ns)
        self._fixed_ns = min(self._fixed_ns, now_ns)
        self._rested_ns = min(self._rested_ns, now_ns)
        self._contradiction = None

    def reset(self, fix: Fix, *, now_ns: int | None = None) -> None:
        """Apply a new localization.

        The person may have walked anywhere, so the old position is discarded. The yaw of {H} is the IMU's yaw
        origin and does not change by walking: the new yaw and the predicted one are fused, which measures
        the rate as well, unless it is likelier that the IMU was turned. If the rays of both fixes overlap in
        time, the new yaw replaces the old one and the rate is kept, so that the same rays never count twice.

        Args:
            fix: the new pose; its stamp may lie before the last prediction.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        state = self._state
        state.advance(fix.stamp_ns)
        late_s = state.late_s(fix.stamp_ns)
        is_new = (fix.since_ns if fix.since_ns is not None else fix.stamp_ns) > self._fixed_ns
        state.forget(X, ANYWHERE_M, fix.x_m)
        state.forget(Y, ANYWHERE_M, fix.y_m)
        if not is_new:
            state.forget(YAW, ANY_YAW_RAD)
            state.means[:, YAW] = fix.yaw_rad + late_s * state.means[:, RATE]
        yaw = self._yaw_innovation(fix.yaw_rad, late_s)
        value = np.zeros((len(yaw.value), 3))
        slope = np.zeros((len(yaw.value), 3, 5))
        slope[:, [0, 1], [X, Y]] = 1.0
        value[:, 2:], slope[:, 2:] = yaw
        noise = bounded(nearest_psd(fix.covariance), self._settings) + state.walked(late_s)[:3, :3]
        state.update(Innovation(value, slope), self._cases(noise, moved_m=0.0)[: 2 if is_new else 1])
        self._took(fix)

    def reset_yaw(self, stamp_ns: int, *, is_restarted: bool) -> None:
        """Make the yaw unknown because the IMU's yaw origin changes at `stamp_ns`.

        Args:
            stamp_ns: time of the change.
            is_restarted: True if the device was restarted, which makes its drift unknown, too.
        """
        self.set_time(stamp_ns)
        self._state.advance(stamp_ns)
        self._state.forget(YAW, 0.5 * self._settings.max_yaw_sigma_rad)
        if is_restarted:
            self._state.forget(RATE, self._settings.rate_sigma_radps, 0.0)

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
        sigma_rad: float | None = None,
        now_ns: int | None = None,
    ) -> AnchorResult:
        """Apply one pointing at a known place without a cursor.

        Rejected if it is likelier that the yaw leaped, the person moved or they pointed elsewhere. The pose
        is the likeliest of them: that of a leap if the ray was as high as the target. Its covariance has the
        others too, and the next anchor shows which is right.

        Args:
            stamp_ns: middle of the hold; the filter advances to it if it is newer.
            target_m: {W}.
            origin_m: of the ray, {H}.
            direction_h: mean of the unfiltered rays without the person's offset, {H}; any length but 0.
            elevation_bias_rad: of the pose: the angle by which rays lie above the targets.
            spread_rad: rms of the rays about their mean.
            sigma_rad: standard deviation of the pointing sideways. None: `DriftSettings.anchor_sigma_rad`.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        settings = self._settings
        measurement = AnchorMeasurement(
            stamp_ns=stamp_ns,
            target_m=(target_m[0], target_m[1], target_m[2] - self._floor_m),
            origin_m=origin_m,
            azimuth_rad=vector.azimuth(direction_h),
            elevation_rad=vector.elevation(direction_h) - elevation_bias_rad,
            spread_rad=spread_rad,
        )
        rejection = self._untimely(stamp_ns) or self._unusable(measurement)
        if rejection:
            return AnchorResult(accepted=False, reason=rejection)
        state = self._state
        state.advance(stamp_ns)
        late_s = state.late_s(stamp_ns)
        level = math.cos(measurement.elevation_rad)
        azimuth_sigma = math.hypot(sigma_rad or settings.anchor_sigma_rad, spread_rad) / level
        noise = np.diag([azimuth_sigma**2, settings.elevation_sigma_rad**2 + spread_rad**2])
        sideways = settings.turned_sigma_rad / level
        elsewhere = np.diag([sideways**2, settings.outlier_elevation_sigma_rad**2])
        seen = innovation(state.means, measurement, late_s)
        off = -innovation(state.moments()[0][None], measurement, late_s).value[0]
        sigmas = state.innovation_sigmas(seen, noise)
        usual, moved, missed = state.update(
            seen,
            [
                *self._cases(noise, settings.moved_sigma_m),
                Case(settings.rare_share, noise + elsewhere, np.zeros(5)),
            ],
        )
        accepted = bool(usual >= max(moved, missed))
        if accepted:
            self._anchored_ns = max(self._anchored_ns, stamp_ns)
        return AnchorResult(
            accepted=accepted,
            azimuth_error_rad=float(off[0]),
            elevation_error_rad=float(off[1]),
            reason="" if accepted else _sentence(off, sigmas),
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

        People do this on purpose, so it is never rejected: if it is likelier that the IMU was turned, the yaw
        is replaced.

        Args:
            stamp_ns: time of pointing.
            azimuth_w_rad: of that direction, {W}.
            direction_h: of the ray without the person's offset, {H}; any length but 0.
            sigma_rad: standard deviation of such pointing, > 0.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        rejection = self._untimely(stamp_ns)
        if not rejection and abs(vector.elevation(direction_h)) > self._settings.max_elevation_rad:
            rejection = "the arm points too steeply for a direction; point level at the wall"
        if rejection:
            return AnchorResult(accepted=False, reason=rejection)
        state = self._state
        state.advance(stamp_ns)
        late_s = state.late_s(stamp_ns)
        yaw_rad = azimuth_w_rad - vector.azimuth(direction_h)
        mean, _ = state.moments()
        away = math.remainder(yaw_rad - float(mean[YAW] - late_s * mean[RATE]), math.tau)
        _, moved = state.update(
            self._yaw_innovation(yaw_rad, late_s), self._cases(np.array([[sigma_rad**2]]), moved_m=0.0)
        )
        self._anchored_ns = max(self._anchored_ns, stamp_ns)
        note = f"the yaw was off by {math.degrees(away):+.0f}° and was replaced" if moved > 0.5 else ""
        return AnchorResult(accepted=True, azimuth_error_rad=away, note=note)

    def update_rest_rate(
        self,
        stamp_ns: int,
        yaw_rate_radps: float,
        sigma_radps: float,
        *,
        is_raised: bool = False,
        now_ns: int | None = None,
    ) -> AnchorResult:
        """Apply the yaw rate of a resting arm; see `RestYawRate`.

        A raised arm creeps at a rate that is constant for one person, which is estimated, too. A rest beside
        the known drift is rejected, for a person may turn. Two in succession that agree with each other end
        the known drift, and the yaw is uncertain by what it may have missed since it was last confirmed.

        Args:
            stamp_ns: middle of the rest; up to `MAX_REST_AGE_S` old.
            yaw_rate_radps: of {H} in {W}: minus the rate at which the IMU turned.
            sigma_radps: its standard deviation, > 0.
            is_raised: True unless the arm hangs.
            now_ns: the time, see `set_time`.
        """
        self.set_time(now_ns)
        settings = self._settings
        state = self._state
        noise = np.array([[sigma_radps**2]])
        allowed = settings.gate * (sigma_radps + (settings.creep_sigma_radps if is_raised else 0.0))
        if abs(yaw_rate_radps) > settings.max_rate_radps + allowed:
            return AnchorResult(accepted=False, reason="the arm turned faster than any IMU drifts; rest it")
        if stamp_ns < state.stamp_ns - MAX_REST_AGE_S * NS_PER_S:
            return AnchorResult(accepted=False, reason="the rest is more than a minute old; check the clocks")
        state.advance(stamp_ns)
        slope = np.zeros((len(state.means), 1, 5))
        slope[:, 0, RATE] = 1.0
        slope[:, 0, CREEP] = float(is_raised)
        seen = Innovation(yaw_rate_radps - np.einsum("nki,ni->nk", slope, state.means), slope)
        away = float(state.weights @ seen.value[:, 0])
        last = self._contradiction
        self._contradiction = None
        if abs(away) > settings.gate * float(state.innovation_sigmas(seen, noise)[0]):
            is_confirmed = (
                last is not None
                and 0 < stamp_ns - last[0] <= MAX_REST_AGE_S * NS_PER_S
                and abs(yaw_rate_radps - last[1]) <= settings.gate * math.hypot(sigma_radps, last[2])
            )
            if not is_confirmed:
                self._contradiction = (stamp_ns, yaw_rate_radps, sigma_radps)
                reason = (
                    f"the resting arm turned {math.degrees(away) * 60:+.0f}° a minute beside the known "
                    "drift; rest it on something that does not move"
                )
                return AnchorResult(accepted=False, reason=reason)
            known_ns = max(self._rested_ns, self._anchored_ns, self._fixed_ns)
            state.forget(RATE, settings.rate_sigma_radps)
            state.covariances[:, YAW, YAW] += (away * max(0, stamp_ns - known_ns) / NS_PER_S) ** 2
        self._rested_ns = max(self._rested_ns, stamp_ns)
        state.update(seen, [Case(1.0, noise, np.zeros(5))])
        return AnchorResult(accepted=True)

    def _cases(self, noise: Array, moved_m: float) -> list[Case]:
        """Return the cases that nothing unusual happened, and that the yaw leaped or the person moved."""
        settings = self._settings
        moved = np.zeros(5)
        moved[[X, Y, YAW]] = moved_m**2, moved_m**2, settings.turned_sigma_rad**2
        rare = settings.rare_share
        return [Case(1.0 - 2.0 * rare, noise, np.zeros(5)), Case(rare, noise, moved)]

    def _yaw_innovation(self, yaw_rad: float, late_s: float) -> Innovation:
        """Return the comparison of a yaw that was measured `late_s` ago with the state."""
        means = self._state.means
        away = yaw_rad - means[:, YAW] + late_s * means[:, RATE]
        slope = np.zeros((len(means), 1, 5))
        slope[:, 0, YAW] = 1.0
        slope[:, 0, RATE] = -late_s
        return Innovation((np.remainder(away + math.pi, math.tau) - math.pi)[:, None], slope)

    def _took(self, fix: Fix) -> None:
        self._floor_m = fix.floor_m
        self._fixed_ns = fix.until_ns if fix.until_ns is not None else fix.stamp_ns
        if fix.is_anchored:
            self._anchored_ns = fix.stamp_ns

    def _untimely(self, stamp_ns: int) -> str:
        late_s = self._state.late_s(stamp_ns)
        if late_s <= self._settings.max_late_s:
            return ""
        return f"the pointing is {late_s:.0f} s old; check the IMU's radio and the clocks, and point again"

    def _unusable(self, measurement: AnchorMeasurement) -> str:
        if abs(measurement.elevation_rad) > self._settings.max_elevation_rad:
            return "the target is too steeply above or below; choose one farther away"
        if predicted_bearing(self._state.moments()[0][None], measurement)[2][0] < NEAREST_M:
            return "the person would stand on the target; choose one farther away"
        return ""


def _sentence(off: Array, sigmas: Array) -> str:
    """Return the reason to reject a pointing `off` by azimuth and elevation, rad; 1 sigma of each."""
    worst = int(np.argmax(np.abs(off) / sigmas))
    by = math.degrees(off[worst])
    side = ("to the left of" if by > 0 else "to the right of", "above" if by > 0 else "below")[worst]
    return (
        f"the target was {abs(by):.0f}° {side} the ray; see which target is meant, and point at that target "
        "again, arm straight"
    )
