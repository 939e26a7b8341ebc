"""Pose between localizations: tracked while the IMU drifts, corrected by anchors and landings.

Owns the drift filter and the rest detector. Pure: poses, rays, orientations and the time go in; poses to
publish, anchors and metrics come out.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Lamp, PointingRay, UserPose
from pointit.services.localizer.drift.filter import AnchorResult, DriftFilter, DriftSettings, Fix
from pointit.services.localizer.drift.rest_detection import RestDetector, RestYawRate
from pointit.services.localizer.drift.state import bounded as bounded_covariance
from pointit.services.localizer.drift.state import nearest_psd
from pointit.services.localizer.estimation.unfiltered_rays import Mean
from pointit.services.localizer.outputs import AnchorOutcome, Output, anchor_message, covariance_of, followed
from pointit.services.localizer.pose_publish_timer import PosePublishTimer

MAX_ELEVATIONS = 8
"""Number of measurements over which a person's elevation bias is averaged."""
MAX_ERROR_RAD = math.radians(25.0)
"""Error above which a landing was not at the target, rad."""

FIGURES = (
    ("drift", "°/min"),
    ("anchor age", "s"),
    ("position σ", "m"),  # noqa: RUF001 - sigma is meant
    ("yaw σ", "°"),  # noqa: RUF001 - sigma is meant
)

GIVEN_SIGMA_M = 0.05
GIVEN_SIGMA_RAD = math.radians(15.0)
"""Standard deviations of a pose that was set, once pointing corrects it."""

FIX_COVARIANCE: Array = np.diag([GIVEN_SIGMA_M**2, GIVEN_SIGMA_M**2, GIVEN_SIGMA_RAD**2])
"""The same as a covariance of x, y, yaw."""

NO_POSE = "no pose is known yet; localize first, or set one"

MEASURED = "a tracker provides the pose, so the anchor only measures the person's offset; nothing to do"
"""Reason why a good anchor does not correct the pose."""


def is_exact(pose: UserPose) -> bool:
    """Return True if `pose` was set as exact, rather than found."""
    return pose.method == "fixed" and not any(pose.covariance)


def to_fix(pose: UserPose, covariance: Array, stamp_ns: int) -> Fix:
    """Return `pose` as it was at `stamp_ns`, with `covariance` (3 x 3)."""
    return Fix(
        x_m=pose.position_m[0],
        y_m=pose.position_m[1],
        yaw_rad=pose.yaw_rad,
        covariance=covariance,
        stamp_ns=stamp_ns,
        floor_m=pose.position_m[2],
        is_anchored=pose.method in ("static_targets", "moving_target"),
    )


class PoseBias:
    """Bias of a pose, and the part that the person's offset already removes from the rays.

    Rays of a calibrated person have no bias. Without the offset the bias is again what it was.
    """

    def __init__(self) -> None:
        self.calibration_rad: float | None = None
        """Remaining elevation uncertainty of the person's calibration, by the newest ray."""
        self._correction_rad = 0.0
        """Elevation correction of the offset, by the newest ray."""
        self._raw_rad = 0.0
        """Elevation of rays above the targets without the offset."""

    def set(self, pose: UserPose) -> None:
        """Set the bias of rays as they are now: that of `pose`, or 0 if it was set, since none is known."""
        self._raw_rad = 0.0 if pose.method == "fixed" else pose.elevation_bias_rad - self._correction_rad

    def on_ray(self, ray: PointingRay) -> float | None:
        """Update the offset from `ray`. Return the bias if it changed, else None."""
        self._correction_rad = ray.elevation_correction_rad
        sigma_rad = ray.elevation_sigma_rad
        if sigma_rad == self.calibration_rad:
            return None
        self.calibration_rad = sigma_rad
        return self._raw_rad if sigma_rad is None else 0.0


class PoseTracker:
    """Keeps the pose, its source and its change with time."""

    def __init__(self, settings: DriftSettings | None = None, *, follow: bool | None = None) -> None:
        """Start without a pose.

        Args:
            settings: of the drift filter.
            follow: whether poses change with time. None: only those found by pointing.
        """
        self._settings = settings if settings is not None else DriftSettings()
        self._may_follow = follow
        self._rest_detector = RestDetector()
        self._publish_timer = PosePublishTimer()
        self._base: UserPose | None = None
        """The pose as it was found or set."""
        self._filter: DriftFilter | None = None
        self._is_estimated = False
        """True if the filter estimates the pose: a pose that was set counts until pointing corrects it."""
        self._follows = False
        self._is_outside = False
        self._has_lost_yaw = False
        self._bias = PoseBias()
        self._elevations = 1
        """Number of measurements in the bias: that of the pose, and of landings. At most `MAX_ELEVATIONS`."""

    @property
    def base(self) -> UserPose | None:
        """Return the pose as found or set by any source, or None if unknown."""
        return self._base

    @property
    def follows(self) -> bool:
        """Return True if the pose changes with time by itself."""
        return self._follows

    def set_localized(self, pose: UserPose, since_ns: int, middle_ns: int, now_ns: int) -> UserPose:
        """Set the pose of a localization. Return the pose to publish.

        Args:
            pose: stamped with its newest ray.
            since_ns: stamp of its first ray.
            middle_ns: stamp of its middle ray, the time of the mean yaw of an IMU that drifts.
            now_ns: the time.
        """
        known = self._filter if self._follows else None
        self._set(pose, follow=self._may_follow is not False)
        if not self._follows:
            return self._publish_timer.stamped(pose, now_ns)
        fix = to_fix(pose, covariance_of(pose), middle_ns)
        fix = replace(fix, since_ns=since_ns, until_ns=pose.stamp_ns)
        if known is None:
            known = DriftFilter(fix, self._settings)
        else:
            known.reset(fix, now_ns=now_ns)
        self._filter = known
        self._is_estimated = True
        return self._message(pose.stamp_ns, now_ns)

    def restore(self, pose: UserPose, now_ns: int) -> UserPose:
        """Set a pose that was found once, with its covariance. Return the pose to publish.

        Drift and time of the last anchor are unknown. The pose before is discarded: it may be the same.
        """
        self._set(pose, follow=self._may_follow is not False)
        if self._follows:
            fix = replace(to_fix(pose, covariance_of(pose), now_ns), is_anchored=False)
            self._filter = DriftFilter(fix, self._settings)
            self._is_estimated = True
        return self._message(now_ns, now_ns)

    def set_exact(self, pose: UserPose, now_ns: int) -> UserPose:
        """Set an exact pose. Return the pose to publish."""
        self._set(pose, follow=self._may_follow is True)
        if self._follows:
            self._filter = DriftFilter(to_fix(pose, np.zeros((3, 3)), pose.stamp_ns), self._settings)
            self._is_estimated = True
        return self._publish_timer.stamped(pose, now_ns)

    def set_external(self, pose: UserPose) -> None:
        """Set the pose of a tracker, which publishes it itself."""
        if not self._is_outside:
            self._set(pose, follow=False)
            self._is_outside = True
        self._base = pose
        self._publish_timer.heard(pose.stamp_ns)

    def on_ray(self, ray: PointingRay, now_ns: int) -> UserPose | None:
        """Update the person's offset from `ray`. Return the pose to publish, or None if it did not change."""
        bias_rad = self._bias.on_ray(ray)
        base = self._base
        if bias_rad is None or base is None or self._is_outside:
            return None
        if bias_rad == base.elevation_bias_rad:
            return None
        self._base = base.model_copy(update={"elevation_bias_rad": bias_rad})
        return self._message(now_ns, now_ns)

    def on_orientation(self, orientation_xyzw: Quaternion, stamp_ns: int, now_ns: int | None = None) -> None:
        """Update the rest detector; only while no cursor is shown."""
        if self._filter is None or not self._follows:
            return
        self._apply_rest(self._rest_detector.add(orientation_xyzw, stamp_ns), now_ns)

    def end_rest(self) -> None:
        """End the present rest: the arm follows something from now on."""
        self._apply_rest(self._rest_detector.end())

    def on_yaw_origin_changed(self, now_ns: int, *, is_restarted: bool) -> UserPose | None:
        """Make the yaw unknown after a change of the IMU's yaw origin. Return the pose to publish.

        None if it does not matter: no pose is known, a tracker provides it, or it was set as exact.

        Args:
            now_ns: the time.
            is_restarted: the device was restarted, so that its drift is unknown, too.
        """
        if is_restarted:
            self._rest_detector = RestDetector()
        else:
            self.end_rest()
        base = self._base
        if base is None or self._is_outside:
            return None
        if is_exact(base) and not self._follows:
            return None
        if self._filter is None:
            self._filter = DriftFilter(to_fix(base, covariance_of(base), now_ns), self._settings)
        self._filter.reset_yaw(now_ns, is_restarted=is_restarted)
        self._is_estimated = self._has_lost_yaw = True
        return self._message(now_ns, now_ns)

    @property
    def has_lost_yaw(self) -> bool:
        """Return True if the yaw was not measured since the IMU's origin changed."""
        return self._has_lost_yaw

    def anchor(self, lamp: Lamp, mean: Mean, rejection: str = "", now_ns: int | None = None) -> AnchorOutcome:
        """Apply one pointing at `lamp` and return the outcome.

        Args:
            lamp: target.
            mean: of the rays.
            rejection: reason to reject it, or `""`.
            now_ns: the time, see `DriftFilter.set_time`.
        """
        if self._filter is not None:
            self._filter.set_time(now_ns)
        base = self._base
        if base is None:
            unknown_pose = UserPose(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)
            result = AnchorResult(accepted=False, reason=NO_POSE)
            return AnchorOutcome(anchor_message(lamp, mean, unknown_pose, result), is_done=False)
        before = self._pose_at(base, mean.stamp_ns)
        is_only_measured = self._is_outside and not rejection
        if is_only_measured:
            rejection = MEASURED

        # A rejected anchor is only measured, by a filter that is discarded
        if rejection:
            drift_filter = self._temporary_filter(before, mean.stamp_ns)
        else:
            drift_filter = self._present_filter(base, mean.stamp_ns)
        result = drift_filter.update_anchor(
            mean.stamp_ns,
            lamp.position_m,
            mean.origin_m,
            mean.direction,
            elevation_bias_rad=base.elevation_bias_rad,
            spread_rad=mean.spread_rad,
            sigma_rad=mean.sigma_rad,
            now_ns=now_ns,
        )
        if rejection:
            result = replace(result, accepted=False, reason=rejection)
        elif result.accepted:
            self._follow_filter()
        anchor = anchor_message(lamp, mean, before, result)
        return AnchorOutcome(anchor, is_done=result.accepted or is_only_measured)

    def anchor_at(self, target_id: str, position_m: Vec3, mean: Mean, now_ns: int) -> list[Output]:
        """Apply one pointing at a target that is no lamp, as `anchor`. Return the messages to publish."""
        outcome = self.anchor(Lamp(id=target_id, position_m=position_m), mean, "", now_ns)
        outputs: list[Output] = [outcome.anchor]
        pose = self.pose(now_ns) if outcome.anchor.accepted else None
        if pose is not None:
            outputs.append(pose)
        return outputs

    def learn_elevation(self, position_m: Vec3, mean: Mean, now_ns: int) -> list[Output]:
        """Update the bias by a landing at a known position. Return the messages to publish."""
        base = self._base
        if base is None or self._is_outside or self._bias.calibration_rad is not None:
            return []
        pose = self._pose_at(base, mean.stamp_ns)
        eyes_m = vector.add(pose.position_m, vector.rotate_z(mean.origin_m, pose.yaw_rad))
        target_rad = vector.elevation(vector.subtract(position_m, eyes_m))
        error_rad = vector.elevation(mean.direction) - target_rad - base.elevation_bias_rad
        max_age_ns = self._settings.max_late_s * NS_PER_S
        if abs(error_rad) > MAX_ERROR_RAD or now_ns - mean.stamp_ns > max_age_ns:
            return []

        # Mean of the measurements, of the last ones once there are many
        self._elevations = min(self._elevations + 1, MAX_ELEVATIONS)
        bias_rad = base.elevation_bias_rad + error_rad / self._elevations
        self._base = base.model_copy(update={"elevation_bias_rad": bias_rad})
        self._bias.set(self._base)
        return [self._message(now_ns, now_ns)]

    def heading(self, mean: Mean, azimuth_rad: float, now_ns: int | None = None) -> AnchorResult:
        """Apply pointing towards `azimuth_rad` in {W}; `now_ns` as for an anchor."""
        base = self._base
        if base is None or self._is_outside:
            return AnchorResult(accepted=False, reason=NO_POSE)
        drift_filter = self._present_filter(base, mean.stamp_ns)
        result = drift_filter.update_heading(mean.stamp_ns, azimuth_rad, mean.direction, now_ns=now_ns)
        if result.accepted:
            self._follow_filter()
        return result

    def pose(self, now_ns: int) -> UserPose | None:
        """Return the pose to publish now, or None if it is unknown or a tracker's."""
        if self._base is None or self._is_outside:
            return None
        return self._message(now_ns, now_ns)

    def due(self, now_ns: int) -> UserPose | None:
        """Return the pose if it is time to publish it again, else None."""
        if self._filter is None or not self._follows:
            return None
        if not self._publish_timer.is_due(self._filter.predict(now_ns)):
            return None
        return self._message(now_ns, now_ns)

    def wait_s(self, now_ns: int) -> float:
        """Return the time until the next check of `due`, s."""
        if self._filter is None:
            return math.inf
        return self._publish_timer.wait_s(now_ns, self._filter.at)

    def uncertainty(self, now_ns: int) -> tuple[tuple[float, float], Array]:
        """Return x and y, and the covariance of (x, y, yaw) with the uncertainty of a pose that was set.

        Raises:
            ValueError: If no pose is known.
        """
        if self._base is None:
            raise ValueError(NO_POSE)
        pose = self._pose_at(self._base, now_ns)
        covariance = nearest_psd(covariance_of(pose))
        covariance = covariance + (0.0 if self._is_estimated else FIX_COVARIANCE)
        return pose.position_m[:2], bounded_covariance(covariance, self._settings)

    def figures(self, now_ns: int) -> Iterator[tuple[str, float | None, str]]:
        """Yield name, value and unit of the health metrics, None if nothing is estimated."""
        values: tuple[float | None, ...] = (None,) * len(FIGURES)
        if self._filter is not None and self._is_estimated:
            pose = self._filter.at(now_ns)
            anchor_age_s: float | None = None
            if pose.anchored_ns:
                anchor_age_s = max(0, now_ns - pose.anchored_ns) / NS_PER_S
            values = (
                math.degrees(pose.yaw_rate_radps) * 60.0,
                anchor_age_s,
                pose.position_sigma_m,
                math.degrees(pose.yaw_sigma_rad),
            )
        for (name, unit), value in zip(FIGURES, values, strict=True):
            yield name, value, unit

    def yaw_sigma_rad(self, now_ns: int) -> float:
        """Return the standard deviation of the yaw; 0 if nothing is estimated."""
        if self._filter is None or not self._is_estimated:
            return 0.0
        return self._filter.at(now_ns).yaw_sigma_rad

    def _set(self, pose: UserPose, *, follow: bool) -> None:
        self._base = pose
        self._bias.set(pose)
        self._elevations = 1
        self._filter = None
        self._is_estimated = self._is_outside = self._has_lost_yaw = False
        self._follows = follow
        self._rest_detector = RestDetector()

    def _apply_rest(self, rest: RestYawRate | None, now_ns: int | None = None) -> None:
        """Apply the rate of a rest, if there is one and the pose follows the drift."""
        if rest is None or self._filter is None or not self._follows:
            return
        self._filter.update_rest_rate(
            rest.stamp_ns,
            rest.yaw_rate_radps,
            rest.sigma_radps,
            is_raised=rest.is_raised,
            now_ns=now_ns,
        )

    def _present_filter(self, base: UserPose, stamp_ns: int) -> DriftFilter:
        """Return the filter of the pose, which starts at `base` if there was none."""
        self._filter = self._filter or self._temporary_filter(base, stamp_ns)
        return self._filter

    def _temporary_filter(self, pose: UserPose, stamp_ns: int) -> DriftFilter:
        """Return a filter that starts at `pose` with the uncertainty `FIX_COVARIANCE`."""
        covariance = covariance_of(pose) + FIX_COVARIANCE
        return DriftFilter(to_fix(pose, covariance, stamp_ns), self._settings)

    def _follow_filter(self) -> None:
        """Publish what the filter estimates from now on, as pointing has corrected it."""
        self._is_estimated = True
        self._has_lost_yaw = False
        self._follows = self._may_follow is not False

    def _pose_at(self, base: UserPose, stamp_ns: int) -> UserPose:
        if self._filter is None or not self._is_estimated:
            return base
        return followed(base, self._filter.at(stamp_ns))

    def _message(self, stamp_ns: int, now_ns: int) -> UserPose:
        base = self._base
        if base is None:
            raise ValueError(NO_POSE)
        if self._filter is not None:
            self._filter.set_time(now_ns)
        pose = self._pose_at(base, stamp_ns)
        pose = pose.model_copy(update={"stamp_ns": max(stamp_ns, 0)})
        return self._publish_timer.stamped(pose, now_ns)
