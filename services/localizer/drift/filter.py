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
    means_then = means.copy()
    means_then[:, YAW] -= late_s * means_then[:, RATE]
    expected_rad, slope, _ = predicted_bearing(means_then, measurement)
    slope[:, :, RATE] = -late_s * slope[:, :, YAW]
    measured_rad = np.array([measurement.azimuth_rad, measurement.elevation_rad])
    value = measured_rad - expected_rad
    azimuth_errors = value[:, 0]
    value[:, 0] = np.remainder(azimuth_errors + math.pi, math.tau) - math.pi
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
    # Eyes relative to the feet, turned from {H} to {W}
    yaw = means[:, YAW]
    cos_yaw = np.cos(yaw)
    sin_yaw = np.sin(yaw)
    origin_x, origin_y, origin_z = measurement.origin_m
    eye_x = cos_yaw * origin_x - sin_yaw * origin_y
    eye_y = sin_yaw * origin_x + cos_yaw * origin_y

    # Target relative to the eyes. A person exactly below the target has no bearing, but must not divide by 0.
    target_x, target_y, target_z = measurement.target_m
    east = target_x - means[:, X] - eye_x
    north = target_y - means[:, Y] - eye_y
    up = target_z - origin_z
    away = np.maximum(np.hypot(east, north), 1e-9)
    square = away * away

    # Derivatives of the azimuth (row 0) and of the elevation (row 1)
    slope = np.zeros((len(means), 2, means.shape[1]))
    slope[:, 0, X] = north / square
    slope[:, 0, Y] = -east / square
    along_eye = east * eye_x + north * eye_y
    across_eye = east * eye_y - north * eye_x
    slope[:, 0, YAW] = -1.0 - along_eye / square
    elevation_slope = -up / (square + up * up)
    slope[:, 1, X] = -elevation_slope * east / away
    slope[:, 1, Y] = -elevation_slope * north / away
    slope[:, 1, YAW] = elevation_slope * across_eye / away

    azimuths = np.arctan2(north, east) - yaw
    elevations = np.arctan2(up, away)
    return np.stack([azimuths, elevations], axis=1), slope, away


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
        self._store_fix_times(fix)

    def set_time(self, now_ns: int | None) -> None:
        """Set the time. A clock step back beyond the age limit of measurements moves the state back, too.

        The other methods do this first with their own time. Without it a measurement after a clock step back
        looks too old.

        Args:
            now_ns: None if not known.
        """
        if now_ns is None:
            return
        max_late_ns = self._settings.max_late_s * NS_PER_S
        if now_ns >= self._state.stamp_ns - max_late_ns:
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
        since_ns = fix.stamp_ns if fix.since_ns is None else fix.since_ns
        is_new = since_ns > self._fixed_ns

        # What is known of the position is dropped, of the yaw only if the same rays gave it
        state.forget(X, ANYWHERE_M, fix.x_m)
        state.forget(Y, ANYWHERE_M, fix.y_m)
        if not is_new:
            state.forget(YAW, ANY_YAW_RAD)
            state.means[:, YAW] = fix.yaw_rad + late_s * state.means[:, RATE]

        # The states were just set to the measured position, so that its innovation is 0
        yaw_innovation = self._yaw_innovation(fix.yaw_rad, late_s)
        components = len(yaw_innovation.value)
        value = np.zeros((components, 3))
        slope = np.zeros((components, 3, 5))
        slope[:, [0, 1], [X, Y]] = 1.0
        value[:, 2:] = yaw_innovation.value
        slope[:, 2:] = yaw_innovation.slope
        noise = bounded(nearest_psd(fix.covariance), self._settings)
        noise = noise + state.walked(late_s)[:3, :3]

        # A yaw that replaces the old one cannot show a leap: only the usual case is left
        cases = self._cases(noise, moved_m=0.0)
        if not is_new:
            cases = cases[:1]
        state.update(Innovation(value, slope), cases)
        self._store_fix_times(fix)

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
        rejection = self._lateness_problem(stamp_ns) or self._geometry_problem(measurement)
        if rejection:
            return AnchorResult(accepted=False, reason=rejection)
        state = self._state
        state.advance(stamp_ns)
        late_s = state.late_s(stamp_ns)

        # Noise of a pointing at the target, and the additional one of a pointing elsewhere. An angle sideways
        # is a larger azimuth the steeper the ray is.
        cos_elevation = math.cos(measurement.elevation_rad)
        sideways_sigma = math.hypot(sigma_rad or settings.anchor_sigma_rad, spread_rad)
        azimuth_sigma = sideways_sigma / cos_elevation
        elevation_variance = settings.elevation_sigma_rad**2 + spread_rad**2
        noise = np.diag([azimuth_sigma**2, elevation_variance])
        elsewhere_azimuth_sigma = settings.turned_sigma_rad / cos_elevation
        elsewhere_noise = np.diag([elsewhere_azimuth_sigma**2, settings.outlier_elevation_sigma_rad**2])

        # Errors are reported relative to the pose before the update, and so are their sigmas
        innovations = innovation(state.means, measurement, late_s)
        likeliest_mean, _ = state.moments()
        errors = -innovation(likeliest_mean[None], measurement, late_s).value[0]
        sigmas = state.innovation_sigmas(innovations, noise)

        # The update keeps all three explanations. The pointing is accepted if nothing unusual is likeliest.
        cases = self._cases(noise, settings.moved_sigma_m)
        cases.append(Case(settings.rare_share, noise + elsewhere_noise, np.zeros(5)))
        usual, moved, missed = state.update(innovations, cases)
        accepted = bool(usual >= max(moved, missed))
        if accepted:
            self._anchored_ns = max(self._anchored_ns, stamp_ns)
        return AnchorResult(
            accepted=accepted,
            azimuth_error_rad=float(errors[0]),
            elevation_error_rad=float(errors[1]),
            reason="" if accepted else _rejection_reason(errors, sigmas),
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
        rejection = self._lateness_problem(stamp_ns)
        if not rejection and abs(vector.elevation(direction_h)) > self._settings.max_elevation_rad:
            rejection = "the arm points too steeply for a direction; point level at the wall"
        if rejection:
            return AnchorResult(accepted=False, reason=rejection)
        state = self._state
        state.advance(stamp_ns)
        late_s = state.late_s(stamp_ns)

        # The error is that of the likeliest state before the update
        yaw_rad = azimuth_w_rad - vector.azimuth(direction_h)
        mean, _ = state.moments()
        expected_yaw_rad = float(mean[YAW] - late_s * mean[RATE])
        error_rad = math.remainder(yaw_rad - expected_yaw_rad, math.tau)

        cases = self._cases(np.array([[sigma_rad**2]]), moved_m=0.0)
        _, leaped = state.update(self._yaw_innovation(yaw_rad, late_s), cases)
        self._anchored_ns = max(self._anchored_ns, stamp_ns)
        note = ""
        if leaped > 0.5:
            note = f"the yaw was off by {math.degrees(error_rad):+.0f}° and was replaced"
        return AnchorResult(accepted=True, azimuth_error_rad=error_rad, note=note)

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
        creep_sigma_radps = settings.creep_sigma_radps if is_raised else 0.0
        allowed_radps = settings.gate * (sigma_radps + creep_sigma_radps)
        if abs(yaw_rate_radps) > settings.max_rate_radps + allowed_radps:
            return AnchorResult(accepted=False, reason="the arm turned faster than any IMU drifts; rest it")
        if stamp_ns < state.stamp_ns - MAX_REST_AGE_S * NS_PER_S:
            return AnchorResult(accepted=False, reason="the rest is more than a minute old; check the clocks")

        # Rate that the states do not expect
        state.advance(stamp_ns)
        slope = np.zeros((len(state.means), 1, 5))
        slope[:, 0, RATE] = 1.0
        slope[:, 0, CREEP] = float(is_raised)
        expected_radps = np.einsum("nki,ni->nk", slope, state.means)
        innovations = Innovation(yaw_rate_radps - expected_radps, slope)
        error_radps = float(state.weights @ innovations.value[:, 0])
        error_sigma_radps = float(state.innovation_sigmas(innovations, noise)[0])

        # A contradiction is forgotten by the next rest, whatever that shows: two must follow one another
        previous = self._contradiction
        self._contradiction = None
        if abs(error_radps) > settings.gate * error_sigma_radps:
            if not self._confirms(previous, stamp_ns, yaw_rate_radps, sigma_radps):
                self._contradiction = (stamp_ns, yaw_rate_radps, sigma_radps)
                reason = (
                    f"the resting arm turned {math.degrees(error_radps) * 60:+.0f}° a minute beside the "
                    "known drift; rest it on something that does not move"
                )
                return AnchorResult(accepted=False, reason=reason)

            # The rate has changed at an unknown time since the yaw was last confirmed
            confirmed_ns = max(self._rested_ns, self._anchored_ns, self._fixed_ns)
            state.forget(RATE, settings.rate_sigma_radps)
            missed_rad = error_radps * max(0, stamp_ns - confirmed_ns) / NS_PER_S
            state.covariances[:, YAW, YAW] += missed_rad**2
        self._rested_ns = max(self._rested_ns, stamp_ns)
        state.update(innovations, [Case(1.0, noise, np.zeros(5))])
        return AnchorResult(accepted=True)

    def _confirms(
        self,
        contradiction: tuple[int, float, float] | None,
        stamp_ns: int,
        yaw_rate_radps: float,
        sigma_radps: float,
    ) -> bool:
        """Return True if a rest at `stamp_ns` agrees with a `contradiction` shortly before it."""
        if contradiction is None:
            return False
        previous_ns, previous_radps, previous_sigma_radps = contradiction
        if not 0 < stamp_ns - previous_ns <= MAX_REST_AGE_S * NS_PER_S:
            return False
        difference_sigma_radps = math.hypot(sigma_radps, previous_sigma_radps)
        return abs(yaw_rate_radps - previous_radps) <= self._settings.gate * difference_sigma_radps

    def _cases(self, noise: Array, moved_m: float) -> list[Case]:
        """Return the cases that nothing unusual happened, and that the yaw leaped or the person moved."""
        settings = self._settings
        widened = np.zeros(5)
        widened[[X, Y, YAW]] = moved_m**2, moved_m**2, settings.turned_sigma_rad**2
        rare_share = settings.rare_share
        usual = Case(1.0 - 2.0 * rare_share, noise, np.zeros(5))
        return [usual, Case(rare_share, noise, widened)]

    def _yaw_innovation(self, yaw_rad: float, late_s: float) -> Innovation:
        """Return the comparison of a yaw that was measured `late_s` ago with the state."""
        means = self._state.means
        difference = yaw_rad - means[:, YAW] + late_s * means[:, RATE]
        value = np.remainder(difference + math.pi, math.tau) - math.pi
        slope = np.zeros((len(means), 1, 5))
        slope[:, 0, YAW] = 1.0
        slope[:, 0, RATE] = -late_s
        return Innovation(value[:, None], slope)

    def _store_fix_times(self, fix: Fix) -> None:
        """Store the floor of `fix`, and the times up to which its rays gave yaw and anchor."""
        self._floor_m = fix.floor_m
        self._fixed_ns = fix.until_ns if fix.until_ns is not None else fix.stamp_ns
        if fix.is_anchored:
            self._anchored_ns = fix.stamp_ns

    def _lateness_problem(self, stamp_ns: int) -> str:
        """Return the reason to reject a pointing at `stamp_ns` as too old, or `""`."""
        late_s = self._state.late_s(stamp_ns)
        if late_s <= self._settings.max_late_s:
            return ""
        return f"the pointing is {late_s:.0f} s old; check the IMU's radio and the clocks, and point again"

    def _geometry_problem(self, measurement: AnchorMeasurement) -> str:
        """Return the reason to reject a target that is too steep or too near, or `""`."""
        if abs(measurement.elevation_rad) > self._settings.max_elevation_rad:
            return "the target is too steeply above or below; choose one farther away"
        mean, _ = self._state.moments()
        _, _, distances_m = predicted_bearing(mean[None], measurement)
        if distances_m[0] < NEAREST_M:
            return "the person would stand on the target; choose one farther away"
        return ""


def _rejection_reason(errors: Array, sigmas: Array) -> str:
    """Return the reason to reject a pointing by its errors of azimuth and elevation, rad; 1 sigma of each."""
    azimuth_share, elevation_share = np.abs(errors) / sigmas
    azimuth_deg, elevation_deg = np.degrees(errors).tolist()
    if azimuth_share >= elevation_share:
        error_deg = azimuth_deg
        side = "to the left of" if azimuth_deg > 0 else "to the right of"
    else:
        error_deg = elevation_deg
        side = "above" if elevation_deg > 0 else "below"
    return (
        f"the target was {abs(error_deg):.0f}° {side} the ray; see which target is meant, and point at that "
        "target again, arm straight"
    )
