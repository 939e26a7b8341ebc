"""Parameters of pointing, and its service: reads a person's IMU, profile and pose, and writes their ray."""

import logging
from typing import ClassVar, Literal

from pydantic import Field

from pointit.geometry.one_euro import OneEuro
from pointit.runtime.config.config import Config
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import NS_PER_S, ImuSample, UserPose, UserProfile
from pointit.schemas.problems import LATE
from pointit.schemas.topics import IMU, POSE, PROFILE, RAY
from pointit.services.pointing.pointer import Pointer

log = logging.getLogger(__name__)

MIN_CUTOFF_HZ = {"normal": 0.7, "steady": 0.3}
"""Cut-off of the filter at rest by its setting; pointing.md §2."""
PROFILE_WAIT_S = 1.0
"""Longest wait for the person's measures at the start, before average ones are used, s."""
METRICS_NS = NS_PER_S
"""Period of the metrics, as of Health."""


class PointingConfig(Config):
    """Age limit of orientations, and smoothing of the ray."""

    stale_after_s: float = Field(
        default=0.2,
        gt=0,
        le=10,
        description="maximum age of a sample, or time in the future, for which a ray is published, s",
    )
    filter: Literal["off", "normal", "steady"] = Field(
        default="normal", description="smoothing of the ray (1 € filter); steady: for hands that tremble"
    )

    def smoothing(self) -> OneEuro | None:
        """Return a new filter as configured, or None if it is off."""
        return None if self.filter == "off" else OneEuro(min_cutoff_hz=MIN_CUTOFF_HZ[self.filter])


class Pointing(Service[PointingConfig]):
    """Turns one person's arm orientation into their pointing ray."""

    NAME: ClassVar[str] = "pointing"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = PointingConfig

    def __init__(self, config: PointingConfig, context: Context) -> None:
        super().__init__(config, context)
        self._pointer = Pointer(stale_after_s=config.stale_after_s, one_euro=config.smoothing())
        self._waits = True
        self._fresh_ns: int | None = None
        """Time of the last fresh sample, or None before the first sample."""
        self._is_warned = False
        self._metrics_ns = 0
        self._count = self._repeated = self._restarts = 0
        """Counts at the last update of the metrics."""
        self._rays = self.bus.publisher(RAY, self.user)
        self.bus.subscribe(PROFILE, self._on_profile, self.user)
        self.bus.subscribe(POSE, self._on_pose, self.user)
        self.bus.subscribe(IMU, self._on_imu, self.user)
        self.bus.call_later(PROFILE_WAIT_S, self._go_on)

    def _on_profile(self, profile: UserProfile, _user: str) -> None:
        self._pointer.set_profile(profile)
        self._waits = False
        self.bus.clear("profile")

    def _on_pose(self, pose: UserPose, _user: str) -> None:
        self._pointer.set_yaw(pose.yaw_rad)

    def _go_on(self) -> None:
        """Start without a profile, as when there is no supervisor."""
        if self._waits:
            self._waits = False
            self.bus.warn(
                "profile",
                f"no profile of {self.user} was received: rays assume average body measures; start their "
                "supervisor, which publishes it",
            )

    def _on_imu(self, sample: ImuSample, _user: str) -> None:
        if self._waits:
            return
        now_ns = self.clock.now_ns()
        ray = self._pointer.ray(sample, now_ns)
        if ray is not None:
            self._rays.put(ray)
        if self._pointer.verdict != "fresh" or self._is_warned:
            self._judge(sample, now_ns)
        else:
            self._fresh_ns = now_ns
        is_due = not 0 <= now_ns - self._metrics_ns < METRICS_NS
        if is_due or self._pointer.freshness.restarts > self._restarts:
            self._show_metrics(now_ns)

    def _judge(self, sample: ImuSample, now_ns: int) -> None:
        """Warn in health about samples that make no ray, until one does."""
        verdict = self._pointer.verdict
        if self._fresh_ns is None or verdict in ("fresh", "no direction"):
            self._fresh_ns = now_ns
        if verdict == "fresh":
            self._is_warned = False
            self.bus.clear("samples")
            self.bus.clear(LATE)
        elif verdict != "repeated" or now_ns - self._fresh_ns > self.config.stale_after_s * NS_PER_S:
            self._is_warned = True
            sentence = self._problem(now_ns - sample.stamp_ns)
            is_late = verdict not in ("no direction", "repeated")
            self.bus.warn(LATE, sentence if is_late else "")
            self.bus.warn("samples", "" if is_late else sentence)

    def _show_metrics(self, now_ns: int) -> None:
        freshness = self._pointer.freshness
        if freshness.restarts > self._restarts:
            if not self._restarts:
                log.warning(
                    "%s: the clock of the wrist went back: it was restarted, or two wrists send as one user",
                    self.user,
                )
            self._restarts = freshness.restarts
            self.bus.set_metric("restarts of the wrist", self._restarts)
        count = freshness.count - self._count
        repeated = freshness.repeated - self._repeated
        share = 100.0 * repeated / count if freshness.repeated else None  # most devices never do
        self.bus.set_metric("repeated samples", share, "%")
        self._metrics_ns = now_ns
        self._count = freshness.count
        self._repeated = freshness.repeated

    def _problem(self, age_ns: int) -> str:
        freshness = self._pointer.freshness
        verdict = self._pointer.verdict
        age_s = age_ns / NS_PER_S
        limit_s = self.config.stale_after_s
        if verdict == "no direction":
            return "the finger would be at the eyes: correct the body measures of the person's profile"
        if verdict == "repeated":
            return (
                f"{freshness.repeated} IMU samples repeat the one before and made no ray, no others arrive: "
                "the wrist's device is stuck or its link is down; switch it off and on"
            )
        if age_s < -limit_s:
            what = f"is {-age_s:.1f} s ahead of this machine's clock: synchronize the two clocks"
        elif age_s > limit_s:
            what = f"is {age_s:.1f} s old: look for a slow link, or synchronize the clocks"
        else:
            what = "is out of order: do two sources write it?"
        return f"{freshness.stale} IMU samples made no ray, the last {what}"


SERVICE = Pointing
