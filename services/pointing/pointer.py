"""Conversion of fresh wrist samples to the pointing ray: model, the person's offset, filter.

The pointing ray of an arm in {H}: eye-finger, shoulder-arm or forearm (paper, §II-A; pointing.md §1).

Its correction takes out a person's systematic error (pointing.md §3).

The body faces where the arm points: the shoulder is beside the neck, at a right angle to the arm's azimuth.
{H} itself has no relation to the body, because its yaw is where the IMU happened to start. A body that turns
less than the arm moves the shoulder along the arm at first, which hardly changes the ray.
"""

import math
from typing import Literal

import numpy as np

from pointit.geometry import vector
from pointit.geometry.array_types import Array
from pointit.geometry.one_euro import OneEuro
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, BodyMeasures, ImuSample, PointingOffset, PointingRay, UserProfile
from pointit.schemas.base import unchecked
from pointit.schemas.person import RayModel

Verdict = Literal["fresh", "stale", "repeated"]

UPPER_ARM_SHARE = 0.56
"""Upper arm as a share of the length from shoulder to wrist: 0.186 and 0.146 of the stature (Drillis and
Contini 1966)."""

MIN_REACH_M = 1e-6
"""Smallest distance of the fingertip from the eyes that gives a direction."""

VERTICAL = 1e-6
"""Cosine of the elevation below which an arm has no azimuth: the shoulder is then assumed at the neck."""

MAX_CORRECTION_RAD = math.radians(30.0)
"""Largest correction."""

FADE_RAD = math.radians(10.0)
"""Distance from straight up or down within which a correction fades, since azimuths are undefined there."""

_LEVEL_AT_FADE = math.sin(FADE_RAD)
_calculated_ray = unchecked(PointingRay)


class ArmRay:
    """A person's ray as a function of the orientation of their arm.

    The eye-finger and the shoulder-arm ray assume a straight arm. The forearm ray assumes that the upper arm
    hangs, and starts at the elbow below the shoulder: with a straight arm its line would be the shoulder-arm
    ray.
    """

    def __init__(
        self,
        body: BodyMeasures | None = None,
        *,
        hand: Literal["left", "right"] = "right",
        model: RayModel = "eye_finger",
    ) -> None:
        """Set the person's measures; a left-handed person's shoulder is on the left."""
        body = body if body is not None else BodyMeasures()
        self._side_m = body.neck_to_shoulder_m if hand == "left" else -body.neck_to_shoulder_m
        self._is_from_eyes = model == "eye_finger"
        self._drop_m = body.neck_to_eyes_m
        self._arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
        hang_m = UPPER_ARM_SHARE * body.shoulder_to_wrist_m if model == "forearm" else 0.0
        self._height_m = body.footprint_to_neck_m + (self._drop_m if self._is_from_eyes else -hang_m)
        """Height of the ray's origin above the feet, m."""

    @classmethod
    def from_profile(cls, profile: UserProfile) -> "ArmRay":
        """Return the ray of the person with `profile`."""
        return cls(profile.body, hand=profile.hand, model=profile.ray_model)

    def ray(self, orientation_xyzw: Quaternion) -> tuple[Vec3, Vec3] | None:
        """Return origin and unit direction in {H}, or None if the finger is at the eyes."""
        x, y, z, w = orientation_xyzw
        square = x * x + y * y + z * z + w * w  # norms are 1 to within 1e-3 only
        ahead = square - 2.0 * (y * y + z * z)
        left = 2.0 * (x * y + w * z)
        up = 2.0 * (x * z - w * y)
        shoulder_x = shoulder_y = 0.0
        if self._side_m:
            beside = self._side_m / max(math.hypot(ahead, left), VERTICAL * square)
            shoulder_x = -beside * left
            shoulder_y = beside * ahead
        if not self._is_from_eyes:
            length = math.hypot(ahead, left, up)
            return (shoulder_x, shoulder_y, self._height_m), (ahead / length, left / length, up / length)
        arm = self._arm_m / square
        ahead = arm * ahead + shoulder_x
        left = arm * left + shoulder_y
        up = arm * up - self._drop_m
        length = math.hypot(ahead, left, up)
        if length < MIN_REACH_M:
            return None
        return (0.0, 0.0, self._height_m), (ahead / length, left / length, up / length)

    def rays(self, orientations_xyzw: Array) -> tuple[Array, Array]:
        """Return the rays of many orientations.

        Args:
            orientations_xyzw: n x 4.

        Returns:
            Origins in {H}, n x 3, m; unit directions, n x 3, NaN if the finger is at the eyes.
        """
        x, y, z, w = orientations_xyzw.T
        square = x * x + y * y + z * z + w * w
        arm = np.stack([square - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)], axis=1)
        arm /= square[:, None]
        beside = self._side_m / np.maximum(np.hypot(arm[:, 0], arm[:, 1]), VERTICAL)
        shoulder = np.stack(
            [-beside * arm[:, 1], beside * arm[:, 0], np.full(len(arm), self._height_m)], axis=1
        )
        if not self._is_from_eyes:
            return shoulder, arm / np.linalg.norm(arm, axis=1)[:, None]
        eyes = np.tile([0.0, 0.0, self._height_m], (len(arm), 1))
        reach = self._arm_m * arm + shoulder - eyes - [0.0, 0.0, self._drop_m]
        length = np.linalg.norm(reach, axis=1)
        length[length < MIN_REACH_M] = np.nan
        return eyes, reach / length[:, None]


def apply(
    offset: PointingOffset, azimuth_world_rad: float | None, elevation_rad: float
) -> tuple[float, float]:
    """Return the corrections of the ray's azimuth and elevation, rad.

    Args:
        offset: the person's.
        azimuth_world_rad: of the raw ray in {W}. None while the pose is unknown: then only the elevation is
            corrected, as at the middle azimuth of the anchors.
        elevation_rad: of the raw ray.
    """
    if offset.rung == "pitch":
        azimuth = 0.0
        elevation = offset.elevation[0]
    else:
        a = 0.0 if azimuth_world_rad is None else vector.wrap(azimuth_world_rad - offset.reference_rad)
        a = _clamped(a, offset.azimuth_range_rad)
        e = _clamped(elevation_rad, offset.elevation_range_rad)
        elevation = _value(offset.elevation, a, e)
        azimuth = 0.0 if azimuth_world_rad is None else _value(offset.azimuth, a, e)
    fade = min(1.0, math.cos(elevation_rad) / _LEVEL_AT_FADE)
    azimuth = fade * min(max(azimuth, -MAX_CORRECTION_RAD), MAX_CORRECTION_RAD)
    elevation = fade * min(max(elevation, -MAX_CORRECTION_RAD), MAX_CORRECTION_RAD)
    lowest = -math.pi / 2.0 - elevation_rad
    highest = math.pi / 2.0 - elevation_rad
    return azimuth, min(max(elevation, lowest), highest)


def _clamped(angle_rad: float, bounds: tuple[float, float]) -> float:
    return min(max(angle_rad, bounds[0]), bounds[1])


def _value(terms: tuple[float, float, float, float, float, float], a: float, e: float) -> float:
    c, by_a, by_e, by_aa, by_ae, by_ee = terms
    return c + a * (by_a + a * by_aa + e * by_ae) + e * (by_e + e * by_ee)


class Pointer:
    """Pointing of one person: the orientation of their arm becomes the ray along which they point.

    People point along the line from their eyes to the tip of their finger, not along the arm. With the
    person's measures the orientation of the wrist gives both ends of that line. Their offset (what they
    usually miss by) and a filter of tremor correct its direction. The ray is in the person's own frame {H}:
    it needs no position in the room, so pointing works before anybody is localized.

    >>> from pointit.geometry import rotation
    >>> from pointit.schemas import ImuSample
    >>> ahead = ImuSample(stamp_ns=1, seq=1, orientation_xyzw=rotation.IDENTITY)
    >>> ray = Pointer().ray(ahead, now_ns=1)
    >>> [round(component, 2) for component in ray.origin_m]
    [0.0, 0.0, 1.64]
    >>> ray.direction[0] > 0.9  # along x, ahead of the person
    True

    It surprises that `ray` may return None: a sample that is late, repeated or from the future has no ray.
    `verdict` says which it was.
    """

    def __init__(
        self,
        profile: UserProfile | None = None,
        *,
        stale_after_s: float = 0.2,
        one_euro: OneEuro | None = None,
    ) -> None:
        """Set the person's profile (average measures without one) and the filter, if any."""
        self.freshness = Freshness(stale_after_s)
        self.verdict: Verdict | Literal["no direction"] = "fresh"
        """Verdict on the last sample; "no direction": the finger was at the eyes."""
        self._smoothing = one_euro
        self._yaw_rad: float | None = None
        self._seq = 0
        self.set_profile(profile if profile is not None else UserProfile(stamp_ns=0))

    def set_profile(self, profile: UserProfile) -> None:
        """Set the person's measures and offset, and reset the filter."""
        self._arm = ArmRay.from_profile(profile)
        self._offset = profile.offset
        if self._smoothing is not None:
            self._smoothing.reset()

    def set_yaw(self, yaw_rad: float) -> None:
        """Set the azimuth in {W} of the person's x axis. The person's pointing offset may depend on it."""
        self._yaw_rad = yaw_rad

    def ray(self, sample: ImuSample, now_ns: int) -> PointingRay | None:
        """Return the ray of `sample`, or None if `verdict` is not "fresh"."""
        stamp_ns = sample.stamp_ns
        self.verdict = self.freshness.classify(sample, now_ns)
        if self.verdict != "fresh":
            return None
        found = self._arm.ray(sample.orientation_xyzw)
        if found is None:
            self.verdict = "no direction"
            return None
        origin, raw = found
        direction = raw
        by_azimuth = by_elevation = 0.0
        sigma = None
        offset = self._offset
        if offset is not None:
            azimuth = vector.azimuth(raw)
            elevation = vector.elevation(raw)
            yaw = self._yaw_rad
            by_azimuth, by_elevation = apply(offset, None if yaw is None else azimuth + yaw, elevation)
            direction = vector.direction(azimuth + by_azimuth, elevation + by_elevation)
            sigma = offset.sigma_rad
        if self._smoothing is not None:
            direction = self._smoothing.smooth(direction, stamp_ns / NS_PER_S)
        self._seq += 1
        return _calculated_ray(
            stamp_ns=stamp_ns,
            seq=self._seq,
            origin_m=origin,
            direction=direction,
            raw_direction=raw,
            azimuth_correction_rad=by_azimuth,
            elevation_correction_rad=by_elevation,
            elevation_sigma_rad=sigma,
        )


class Freshness:
    """Compares each sample of one wrist with those before: fresh, stale or repeated.

    Devices and bridges repeat samples (a quarter of all samples in recordings of the ROS toolkit are
    repeats): a repeat has the device time of the sample before. Equal orientations are no evidence, since an
    arm at rest has them, too.
    """

    def __init__(self, stale_after_s: float) -> None:
        """Accept samples at most `stale_after_s` old or in the future."""
        self._stale_ns = int(stale_after_s * NS_PER_S)
        self._newest_ns = -1
        self._device_ns: int | None = None
        self.count = 0
        """Number of all samples."""
        self.stale = 0
        """Number of samples that came too late, out of order, or from the future."""
        self.repeated = 0
        """Number of samples that repeat the one before."""
        self.restarts = 0
        """Number of times that the device's clock went back: it was restarted, or two devices send."""

    def classify(self, sample: ImuSample, now_ns: int) -> Verdict:
        """Return the class of `sample`, and store it if it is fresh.

        A step back of the device's clock is followed. Device times that go back by at most `stale_after_s`
        are samples out of order.
        """
        self.count += 1
        stamp_ns = sample.stamp_ns
        if abs(now_ns - stamp_ns) > self._stale_ns or stamp_ns < self._newest_ns:
            self.stale += 1
            return "stale"
        device_ns = sample.device_time_ns
        before_ns = self._device_ns
        if device_ns is not None:
            if before_ns is not None and device_ns <= before_ns:
                if device_ns == before_ns:
                    self.repeated += 1
                    return "repeated"
                if before_ns - device_ns <= self._stale_ns:
                    self.stale += 1
                    return "stale"
                self.restarts += 1
            self._device_ns = device_ns
        self._newest_ns = stamp_ns
        return "fresh"
