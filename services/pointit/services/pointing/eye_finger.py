"""The eye-finger ray from the orientation of a straight arm (paper, §II-A; pointing.md §1)."""

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, ImuSample, PointingRay, UserProfile


class EyeFinger:
    """Turns orientations of the arm into rays in {H}; keeps nothing but the person's measures."""

    def __init__(self, profile: UserProfile | None = None, *, stale_after_s: float = 0.2) -> None:
        self._stale_ns = int(stale_after_s * NS_PER_S)
        self._newest_ns = -1
        self._seq = 0
        self.stale = 0
        """Samples that came too late, out of order, or from the future."""
        self.set_profile(profile if profile is not None else UserProfile(stamp_ns=0))

    def set_profile(self, profile: UserProfile) -> None:
        """Take the person's measures; a left-handed person's shoulder is on the other side."""
        body = profile.body
        side = 1.0 if profile.hand == "left" else -1.0
        self._eyes: Vec3 = (0.0, 0.0, body.footprint_to_neck_m + body.neck_to_eyes_m)
        self._shoulder: Vec3 = (0.0, side * body.neck_to_shoulder_m, body.footprint_to_neck_m)
        self._arm: Vec3 = (body.shoulder_to_wrist_m + body.wrist_to_finger_m, 0.0, 0.0)

    def ray(self, sample: ImuSample, now_ns: int) -> PointingRay | None:
        """Return the ray of `sample`, or none when it is stale or older than one already used.

        Too far in the future is as wrong as too old. When the clock is set back, it begins anew.
        """
        if self._newest_ns > now_ns + self._stale_ns:
            self._newest_ns = -1
        if abs(now_ns - sample.stamp_ns) > self._stale_ns or sample.stamp_ns < self._newest_ns:
            self.stale += 1
            return None
        self._newest_ns = sample.stamp_ns
        finger = vector.add(self._shoulder, rotation.rotate(sample.orientation_xyzw, self._arm))
        reach = vector.subtract(finger, self._eyes)
        if vector.norm(reach) < 1e-6:  # the finger at the eyes: no direction
            return None
        self._seq += 1
        return PointingRay(
            stamp_ns=sample.stamp_ns,
            seq=self._seq,
            origin_m=self._eyes,
            direction=vector.normalized(reach),
        )
