"""Reads a person's IMU and profile, writes their ray."""

from typing import ClassVar

from pointit.runtime import Context, Service
from pointit.runtime.service import Scope
from pointit.schemas import NS_PER_S, ImuSample, UserProfile
from pointit.schemas.topics import IMU, PROFILE, RAY
from pointit.services.pointing.config import PointingConfig
from pointit.services.pointing.eye_finger import EyeFinger


class Pointing(Service[PointingConfig]):
    """Turns one person's arm orientation into their pointing ray."""

    NAME: ClassVar[str] = "pointing"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = PointingConfig

    def __init__(self, config: PointingConfig, context: Context) -> None:
        super().__init__(config, context)
        self._model = EyeFinger(stale_after_s=config.stale_after_s)
        self._waits = True
        self._rays = self.bus.publisher(RAY, self.user)
        self.bus.subscribe(PROFILE, self._on_profile, self.user)
        self.bus.subscribe(IMU, self._on_imu, self.user)
        self.bus.call_later(config.profile_wait_s, self._go_on)

    def _on_profile(self, profile: UserProfile, _user: str) -> None:
        self._model.set_profile(profile)
        self._waits = False
        self.bus.clear("profile")

    def _go_on(self) -> None:
        """Do without the profile, as where there is no supervisor."""
        if self._waits:
            self._waits = False
            self.bus.warn(
                "profile",
                f"no profile of {self.user} came: rays are those of a body of common measures; start their "
                "supervisor, which publishes it",
            )

    def _on_imu(self, sample: ImuSample, _user: str) -> None:
        if self._waits:
            return
        now_ns = self.clock.now_ns()
        ray = self._model.ray(sample, now_ns)
        if ray is None:
            self.bus.warn("stale", self._complaint((now_ns - sample.stamp_ns) / NS_PER_S))
            return
        self.bus.clear("stale")
        self._rays.put(ray)

    def _complaint(self, age_s: float) -> str:
        limit_s = self.config.stale_after_s
        if age_s < -limit_s:
            what = f"is {-age_s:.1f} s ahead of this machine's clock: synchronize the two clocks"
        elif age_s > limit_s:
            what = f"is {age_s:.1f} s old: look for a slow link, or synchronize the clocks"
        else:
            what = "is out of order: do two sources write it?"
        return f"{self._model.stale} IMU samples made no ray, the last {what}"


SERVICE = Pointing
