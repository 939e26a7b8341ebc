"""Conversion of fresh wrist samples to the pointing ray: model, the person's offset, filter."""

from typing import Literal

from pointit.geometry import vector
from pointit.geometry.one_euro import OneEuro
from pointit.schemas import NS_PER_S, ImuSample, PointingRay, UserProfile
from pointit.schemas.base import unchecked
from pointit.services.pointing.arm_ray import ArmRay, apply

Verdict = Literal["fresh", "stale", "repeated"]

_calculated_ray = unchecked(PointingRay)


class Pointer:
    """Pointing of one person, with their measures, offset, yaw and filter."""

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
        """Set the azimuth in {W} of {H}'s x axis, on which the offset may depend."""
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
            azimuth, elevation = vector.azimuth(raw), vector.elevation(raw)
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
        device_ns, before_ns = sample.device_time_ns, self._device_ns
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
