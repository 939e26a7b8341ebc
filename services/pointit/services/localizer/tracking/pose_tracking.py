"""The pose between localizations: followed while the IMU drifts, set right by anchors and headings.

Owns the drift's filter and the search for rests. Pure: poses, rays, orientations and the time go in; poses
to publish, anchors and figures come out.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pointit.geometry.rotation import Quaternion
from pointit.schemas import Lamp, PointingRay, UserPose
from pointit.services.localizer.drift.filter import AnchorResult, DriftFilter, DriftSettings
from pointit.services.localizer.drift.model import bounded as bounded_covariance
from pointit.services.localizer.drift.model import nearest_psd
from pointit.services.localizer.drift.rest_detection import RestDetector, RestYawRate
from pointit.services.localizer.estimation.angular_residuals import Array
from pointit.services.localizer.estimation.rays import Mean
from pointit.services.localizer.outputs import AnchorOutcome, anchor_message, covariance_of, followed
from pointit.services.localizer.tracking.bias import Bias
from pointit.services.localizer.tracking.fixes import DOUBT, is_exact, to_fix
from pointit.services.localizer.tracking.health_metrics import figures
from pointit.services.localizer.tracking.pose_publish_timer import PosePublishTimer

HEADING_SIGMA_RAD = math.radians(3.0)
"""One sigma of pointing in a known direction."""

NO_POSE = "no pose is known yet; localize first, or set one"

MEASURED = "a tracker gives the pose, so the anchor tells only how the person points; nothing is to be done"
"""Why an anchor that is well does not set the pose right."""


class PoseTracker:
    """Knows the pose, from whom it is, and how it changes."""

    def __init__(self, settings: DriftSettings | None = None, *, follow: bool | None = None) -> None:
        """Know nothing yet.

        Args:
            settings: what is believed of drift.
            follow: whether poses change with time; none: those that pointing has told.
        """
        self._settings = settings if settings is not None else DriftSettings()
        self._may_follow = follow
        self._still = RestDetector()
        self._pace = PosePublishTimer()
        self._base: UserPose | None = None
        """As it was found or given."""
        self._filter: DriftFilter | None = None
        self._is_told = False
        """Whether the filter knows the pose: what was given counts until pointing says otherwise."""
        self._follows = False
        self._is_outside = False
        self._has_lost_yaw = False
        self._bias = Bias()

    @property
    def base(self) -> UserPose | None:
        """Return the pose as it was found or given, by whomever; none when none is known."""
        return self._base

    @property
    def follows(self) -> bool:
        """Return True if the pose changes with time by itself."""
        return self._follows

    def set_localized(self, pose: UserPose, since_ns: int, middle_ns: int, now_ns: int) -> UserPose:
        """Take the pose of a localization; return it as it is to be published.

        Args:
            pose: stamped with its newest ray.
            since_ns: stamp of its first ray.
            middle_ns: stamp of the ray in the middle; of that time is the mean yaw of an IMU that drifts.
            now_ns: the time.
        """
        known = self._filter if self._follows else None
        self._take(pose, follow=self._may_follow is not False)
        self._bias.found(pose.elevation_bias_rad)
        if not self._follows:
            return self._pace.stamped(pose, now_ns)
        fix = to_fix(pose, covariance_of(pose), middle_ns)
        fix = replace(fix, since_ns=since_ns, until_ns=pose.stamp_ns)
        if known is None:
            known = DriftFilter(fix, self._settings)
        else:
            known.reset(fix, now_ns=now_ns)
        self._filter, self._is_told = known, True
        return self._message(pose.stamp_ns, now_ns)

    def restore(self, pose: UserPose, now_ns: int) -> UserPose:
        """Take a pose that was found once, with its covariance; return it as it is to be published.

        Nothing is known of the drift, nor when something told the pose; what was known before is forgotten,
        for it may be the same.
        """
        self._take(pose, follow=self._may_follow is not False)
        if pose.method == "fixed":
            self._bias.given()
        else:
            self._bias.found(pose.elevation_bias_rad)
        if self._follows:
            fix = replace(to_fix(pose, covariance_of(pose), now_ns), is_anchored=False)
            self._filter, self._is_told = DriftFilter(fix, self._settings), True
        return self._message(now_ns, now_ns)

    def set_exact(self, pose: UserPose, now_ns: int) -> UserPose:
        """Take a pose that is exact because somebody says so; return it as it is to be published."""
        self._take(pose, follow=self._may_follow is True)
        self._bias.given()
        if self._follows:
            self._filter = DriftFilter(to_fix(pose, np.zeros((3, 3)), pose.stamp_ns), self._settings)
            self._is_told = True
        return self._pace.stamped(pose, now_ns)

    def set_external(self, pose: UserPose) -> None:
        """Take the pose of a tracker, which is the tracker's to publish."""
        if not self._is_outside:
            self._take(pose, follow=False)
            self._is_outside = True
        self._base = pose
        self._pace.heard(pose.stamp_ns)

    def on_ray(self, ray: PointingRay, now_ns: int) -> UserPose | None:
        """Mind the person's offset; return the pose when it changes with it."""
        bias_rad = self._bias.on_ray(ray)
        base = self._base
        if bias_rad is None or base is None or self._is_outside or bias_rad == base.elevation_bias_rad:
            return None
        self._base = base.model_copy(update={"elevation_bias_rad": bias_rad})
        return self._message(now_ns, now_ns)

    def on_orientation(self, orientation_xyzw: Quaternion, stamp_ns: int, now_ns: int | None = None) -> None:
        """Look for rests of the arm; only while no cursor is shown."""
        if self._filter is None or not self._follows:
            return
        self._rested(self._still.add(orientation_xyzw, stamp_ns), now_ns)

    def end_rest(self) -> None:
        """End the present rest, which counts until now: the arm follows something from now on."""
        self._rested(self._still.end())

    def on_yaw_origin_changed(self, now_ns: int, *, is_restarted: bool) -> UserPose | None:
        """Take that the IMU's yaw origin is another one; return the pose to publish, its yaw unknown.

        None where it does not matter: no pose is known, a tracker has it, or it is exact because somebody
        says so.

        Args:
            now_ns: the time.
            is_restarted: the device was switched on anew, so that its drift is unknown, too.
        """
        if is_restarted:
            self._still = RestDetector()
        else:
            self.end_rest()
        base = self._base
        if base is None or self._is_outside or (is_exact(base) and not self._follows):
            return None
        if self._filter is None:
            self._filter = DriftFilter(to_fix(base, covariance_of(base), now_ns), self._settings)
        self._filter.reset_yaw(now_ns, is_restarted=is_restarted)
        self._is_told = self._has_lost_yaw = True
        return self._message(now_ns, now_ns)

    @property
    def has_lost_yaw(self) -> bool:
        """Return True if nothing has told the yaw since the IMU's origin changed."""
        return self._has_lost_yaw

    def anchor(self, lamp: Lamp, mean: Mean, wrong: str = "", now_ns: int | None = None) -> AnchorOutcome:
        """Take one pointing at `lamp` and return what became of it.

        Args:
            lamp: what was pointed at.
            mean: of the rays.
            wrong: why it must not be taken; empty when it may.
            now_ns: the time, see `DriftFilter.set_time`.
        """
        if self._filter is not None:
            self._filter.set_time(now_ns)
        base = self._base
        if base is None:
            nowhere = UserPose(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)
            result = AnchorResult(accepted=False, reason=NO_POSE)
            return AnchorOutcome(anchor_message(lamp, mean, nowhere, result), is_done=False)
        before = self._at(base, mean.stamp_ns)
        is_only_measured = self._is_outside and not wrong
        wrong = MEASURED if is_only_measured else wrong
        # what must not be taken is only measured
        told = self._doubtful(before, mean.stamp_ns) if wrong else self._believing(base, mean.stamp_ns)
        result = told.update_anchor(
            mean.stamp_ns,
            lamp.position_m,
            mean.origin_m,
            mean.direction,
            elevation_bias_rad=base.elevation_bias_rad,
            spread_rad=mean.spread_rad,
            samples=mean.samples,
            now_ns=now_ns,
        )
        if wrong:
            result = replace(result, accepted=False, reason=wrong)
        elif result.accepted:
            self._believe()
        return AnchorOutcome(
            anchor_message(lamp, mean, before, result), is_done=result.accepted or is_only_measured
        )

    def heading(self, mean: Mean, azimuth_rad: float, now_ns: int | None = None) -> AnchorResult:
        """Take that the person points towards `azimuth_rad` in {W}; the time as for an anchor."""
        base = self._base
        if base is None or self._is_outside:
            return AnchorResult(accepted=False, reason=NO_POSE)
        told = self._believing(base, mean.stamp_ns)
        result = told.update_heading(
            mean.stamp_ns, azimuth_rad, mean.direction, HEADING_SIGMA_RAD, now_ns=now_ns
        )
        if result.accepted:
            self._believe()
        return result

    def pose(self, now_ns: int) -> UserPose | None:
        """Return the pose to publish now; none when none is known, or it is a tracker's."""
        if self._base is None or self._is_outside:
            return None
        return self._message(now_ns, now_ns)

    def due(self, now_ns: int) -> UserPose | None:
        """Return the pose when it is time to publish it again."""
        if self._filter is None or not self._follows:
            return None
        return self._message(now_ns, now_ns) if self._pace.is_due(self._filter.predict(now_ns)) else None

    def wait_s(self, now_ns: int) -> float:
        """Return when to ask again whether it is due, s."""
        return math.inf if self._filter is None else self._pace.wait_s(now_ns, self._filter.at)

    def uncertainty(self, now_ns: int) -> tuple[tuple[float, float], Array]:
        """Return x and y, and the covariance of (x, y, yaw) with what is doubted of a pose that was given.

        Raises:
            ValueError: no pose is known.
        """
        if self._base is None:
            raise ValueError(NO_POSE)
        now = self._at(self._base, now_ns)
        covariance = nearest_psd(covariance_of(now)) + (0.0 if self._is_told else DOUBT)
        return now.position_m[:2], bounded_covariance(covariance, self._settings)

    def figures(self, now_ns: int) -> Iterator[tuple[str, float | None, str]]:
        """Yield name, value and unit of what health shows; no value where nothing is estimated."""
        return figures(self._filter.at(now_ns) if self._filter and self._is_told else None, now_ns)

    def yaw_sigma_rad(self, now_ns: int) -> float:
        """Return one sigma of the yaw; 0 where nothing is estimated."""
        return self._filter.at(now_ns).yaw_sigma_rad if self._filter is not None and self._is_told else 0.0

    def _take(self, pose: UserPose, *, follow: bool) -> None:
        self._base = pose
        self._filter = None
        self._is_told = self._is_outside = self._has_lost_yaw = False
        self._follows = follow
        self._still = RestDetector()

    def _rested(self, told: RestYawRate | None, now_ns: int | None = None) -> None:
        if told is not None and self._filter is not None and self._follows:
            self._filter.update_rest_rate(
                told.stamp_ns,
                told.yaw_rate_radps,
                told.sigma_radps,
                told.creep_sigma_radps,
                now_ns=now_ns,
            )

    def _believing(self, base: UserPose, stamp_ns: int) -> DriftFilter:
        """Return the filter that takes what pointing tells."""
        if self._filter is None:
            self._filter = self._doubtful(base, stamp_ns)
        return self._filter

    def _doubtful(self, pose: UserPose, stamp_ns: int) -> DriftFilter:
        """Return a filter that believes `pose` only so far."""
        return DriftFilter(to_fix(pose, covariance_of(pose) + DOUBT, stamp_ns), self._settings)

    def _believe(self) -> None:
        self._is_told = True
        self._has_lost_yaw = False
        self._follows = self._may_follow is not False

    def _at(self, base: UserPose, stamp_ns: int) -> UserPose:
        """Return the pose at `stamp_ns`."""
        if self._filter is None or not self._is_told:
            return base
        return followed(base, self._filter.at(stamp_ns))

    def _message(self, stamp_ns: int, now_ns: int) -> UserPose:
        base = self._base
        if base is None:
            raise ValueError(NO_POSE)
        if self._filter is not None:
            self._filter.set_time(now_ns)
        pose = self._at(base, stamp_ns)
        return self._pace.stamped(pose.model_copy(update={"stamp_ns": max(stamp_ns, 0)}), now_ns)
