"""Parameters of the localizer."""

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from pointit.runtime.config.config import Config
from pointit.schemas import UserPose
from pointit.schemas.base import Real, Vec3
from pointit.services.localizer.estimation.estimator import SolverSettings
from pointit.services.localizer.estimation_config import DriftConfig, StopCriterionConfig, TrustConfig


def _enough_lamps(count: int) -> int:
    if count == 1:
        raise ValueError("one lamp does not determine a pose; give 2 or more, or 0 for as many as are needed")
    return count


class LocalizerConfig(Config):
    """Parameters of localization."""

    method: Literal["fixed", "static_targets", "moving_target"] = Field(
        default="fixed", description="a pose given here, pointing at lamps, or following a robot"
    )
    position_m: Vec3 = Field(default=(0.0, 0.0, 0.0), description="fixed: where the feet are in the room, m")
    yaw_deg: float = Field(
        default=0.0,
        ge=-360,
        le=360,
        description="fixed: azimuth in the room of the direction in which the IMU's yaw is 0, degrees",
    )
    lamps: tuple[str, ...] = Field(
        default=(), description="static_targets: ids of lamps, in this order; all lamps of the map if empty"
    )
    order: Literal["given", "informative"] = Field(
        default="informative",
        description="static_targets: order of the lamps: as given, or the most informative lamp first",
    )
    targets: Annotated[int, AfterValidator(_enough_lamps)] = Field(
        default=0,
        ge=0,
        le=64,
        description="static_targets: exact number of lamps, 2 or more (in the given order "
        "at most all); 0: all given, or as many as are needed",
    )
    enough: StopCriterionConfig = StopCriterionConfig()
    reaction_s: float = Field(
        default=1.5,
        ge=0,
        le=30,
        description="rays this soon after a lamp lights, or a robot to follow was named, are skipped, s",
    )
    hold_s: float = Field(
        default=2.0, gt=0, le=60, description="static_targets: rays are gathered for this long per lamp, s"
    )
    patience_s: float = Field(
        default=5.0, ge=0, le=600, description="static_targets: how much longer to wait for missing rays, s"
    )
    queue_timeout_s: float = Field(
        default=300.0,
        gt=0,
        le=86400,
        description="static_targets: limit on the wait for lamps that other people use, s",
    )
    steady_degps: float = Field(
        default=8.0,
        ge=0,
        le=360,
        description="static_targets: rays count once they turn no faster, degrees/s; 0: at once",
    )
    max_spread_deg: float = Field(
        default=3.0, gt=0, le=90, description="rms by which an arm may wander at an anchor, degrees"
    )
    robot_id: str = Field(
        default="", description="moving_target: object to follow; the robot that the rays fit best if empty"
    )
    window_s: float = Field(
        default=10.0,
        gt=1,
        le=120,
        description="moving_target: the robot is followed for this long, and older rays are forgotten, s",
    )
    give_up_s: float = Field(
        default=30.0, gt=1, le=3600, description="moving_target: refused when nothing fits until then, s"
    )
    max_place_sigma_m: float = Field(
        default=100.0,
        gt=0,
        le=100,
        description="moving_target: poses by which a place amid the robot's way is less sure are refined, m",
    )
    autostart: bool = Field(
        default=False, description="moving_target: start immediately and refine continuously"
    )
    anchor_at_robots: bool | None = Field(
        default=None,
        description="correct a drifting pose by the rays with which the person takes a robot. If empty, not "
        "on a map with strips; to be switched off where a spotlight shows the cursor",
    )
    floor_m: Real = Field(default=0.0, description="height of the floor in the room's coordinates, m")
    free_height: bool = Field(
        default=False, description="estimate the height of the floor, too, for people on a platform"
    )
    remember: bool = Field(
        default=True,
        description="store what localizations find about the person's pointing, for each device and "
        "mounting, as the prior of the next ones (`pointit person memory`)",
    )
    trust: TrustConfig = TrustConfig()
    track_drift: bool | None = Field(
        default=None,
        description="track the pose while the IMU drifts; if empty, it is tracked unless it is fixed",
    )
    drift: DriftConfig = DriftConfig()

    def fixed(self, stamp_ns: int) -> UserPose:
        """Return the configured pose."""
        return UserPose(stamp_ns=stamp_ns, position_m=self.position_m, yaw_rad=math.radians(self.yaw_deg))

    def believed(self) -> SolverSettings:
        """Return weights and limits of the solver."""
        return self.trust.settings(free_height=self.free_height)
