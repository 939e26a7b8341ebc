"""A localizer that a test plays: it knows where a person points, and how they err."""

import asyncio
import math
import time
from dataclasses import dataclass, field

import pointit.schemas as models
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import RefusedError
from pointit.schemas import topics

EYES: Vec3 = (0.0, 0.0, 1.64)


@dataclass
class PlayedLocalizer:
    """Answers the requests of one person with known angular errors."""

    bus: Bus
    user: str
    lamps: dict[str, Vec3]
    too_low_rad: float = math.radians(4.0)
    """By how much the person's rays are below their targets."""
    yaw_rad: float = 0.3
    """Yaw of the known pose, corrected by anchors."""
    true_yaw_rad: float = 0.3 + math.radians(6.0)
    """The rays are to the right of the targets by the difference."""
    rejects: tuple[str, ...] = ()
    """Lamps whose anchors are rejected."""
    hangs: bool = False
    """True if pointing comes to no end."""
    asked: list[str] = field(default_factory=list[str])
    position_m: Vec3 = (2.0, 0.5, 0.0)
    remembered_bias: models.RememberedBias | None = None
    """Elevation bias that the next localization expects."""

    def __post_init__(self) -> None:
        self._tasks: set[asyncio.Task[None]] = set()
        self._poses = self.bus.publisher(topics.POSE, self.user)
        self._news = self.bus.publisher(topics.LOCALIZATION, self.user)
        self._anchors = self.bus.publisher(topics.ANCHOR, self.user)
        self._tell("idle", since_ns=0)
        self._put_pose()
        self.bus.serve(topics.POINT_ANCHOR, self._point_anchor, self.user)
        self.bus.serve(topics.CANCEL_LOCALIZATION, self._cancel, self.user)
        self.bus.serve(topics.SET_POSE, self._set_pose, self.user)
        self.bus.serve(topics.SET_HEADING, self._set_heading, self.user)

    async def stop(self) -> None:
        for task in self._tasks:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks)

    async def _point_anchor(self, query: models.PointAnchor, _user: str) -> models.Done:
        lamp = query.lamp or next(iter(self.lamps))
        self.asked.append(f"anchor {query.lamp}".strip())
        if lamp not in self.lamps:
            raise RefusedError(f"lamps {lamp} are not on the map")
        task = asyncio.create_task(self._hold(lamp))
        self._tasks.add(task)
        return models.Done(message=f"point at {lamp}")

    async def _hold(self, lamp: str) -> None:
        since_ns = time.time_ns()
        self._tell("sampling", since_ns=since_ns, target_id=lamp)
        await asyncio.sleep(3600.0 if self.hangs else 0.05)
        reason = ""
        if lamp in self.rejects:
            reason = f"the arm wandered while {lamp} was lit"
        self._anchors.put(self._anchor(lamp, reason))
        if reason:
            self._tell("refused", since_ns=since_ns, reason=reason)
            return
        self._tell("solved", since_ns=since_ns)
        self.yaw_rad = self.true_yaw_rad
        self._put_pose(math.radians(1.5), anchored_ns=time.time_ns())

    def _anchor(self, lamp: str, reason: str) -> models.Anchor:
        eyes_m = vector.add(self.position_m, EYES)
        sight = vector.subtract(self.lamps[lamp], eyes_m)
        azimuth = vector.azimuth(sight) - self.true_yaw_rad
        elevation = vector.elevation(sight) - self.too_low_rad
        direction = vector.direction(azimuth, elevation)
        spread_deg = 9.0 if reason else 0.3
        return models.Anchor(
            stamp_ns=time.time_ns(),
            target_id=lamp,
            target_m=self.lamps[lamp],
            origin_m=EYES,
            raw_direction=direction,
            direction=direction,
            spread_rad=math.radians(spread_deg),
            samples=100,
            position_m=self.position_m,
            yaw_rad=self.yaw_rad,
            azimuth_error_rad=self.true_yaw_rad - self.yaw_rad,
            elevation_error_rad=self.too_low_rad,
            accepted=not reason,
            reason=reason,
        )

    async def _cancel(self, query: models.CancelLocalization, _user: str, /) -> models.Done:
        if query.forget_bias:
            self.asked.append("forget")
            self.remembered_bias = None
            self._put_pose()
            return models.Done(message="forgotten: the next localization expects no elevation bias")
        self.asked.append("cancel")
        self._tell("cancelled", since_ns=0)
        return models.Done()

    async def _set_pose(self, query: models.SetPose, _user: str) -> models.Done:
        self.position_m = query.position_m
        yaw_deg = math.degrees(query.yaw_rad)
        self.asked.append(f"pose {query.position_m} {yaw_deg:.1f}")
        self.yaw_rad = query.yaw_rad
        self._put_pose()
        return models.Done(message="the pose is set")

    async def _set_heading(self, query: models.SetHeading, _user: str) -> models.Done:
        azimuth_deg = math.degrees(query.azimuth_rad)
        self.asked.append(f"heading {azimuth_deg:.1f}")
        return models.Done(message="the yaw is set by where you point")

    def _put_pose(self, sigma_rad: float = 0.0, anchored_ns: int = 0) -> None:
        known = 1.0 if sigma_rad else 0.0  # a pose that was given has no covariance
        rate_radps = math.radians(0.2) if anchored_ns else 0.0
        rate_sigma_radps = math.radians(0.1) if anchored_ns else None
        pose = models.UserPose(
            stamp_ns=time.time_ns(),
            position_m=self.position_m,
            yaw_rad=self.yaw_rad,
            covariance=(0.01 * known, 0.0, 0.0, 0.0, 0.0025 * known, 0.0, 0.0, 0.0, sigma_rad**2),
            yaw_rate_radps=rate_radps,
            yaw_rate_sigma_radps=rate_sigma_radps,
            anchored_ns=anchored_ns,
            remembered_bias=self.remembered_bias,
        )
        self._poses.put(pose)

    def _tell(self, phase: str, **more: object) -> None:
        fields = {"stamp_ns": time.time_ns(), "phase": phase, **more}
        if phase != "idle":
            fields["purpose"] = "anchor"
        self._news.put(models.Localization.model_validate(fields))
