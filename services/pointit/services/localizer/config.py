"""Parameters of the localizer."""

import math
from typing import Literal

from pydantic import Field

from pointit.runtime.config import Config
from pointit.schemas.base import Real, Vec3
from pointit.services.localizer.estimator import Trust
from pointit.services.localizer.moving_target import Following
from pointit.services.localizer.static_targets import Timing


class TrustConfig(Config):
    """How far rays are believed, and which poses are accepted."""

    ray_sigma_deg: float = Field(default=2.0, gt=0, le=30, description="1 sigma of one pointing, degrees")
    bias_sigma_deg: float = Field(
        default=10.0, gt=0, le=45, description="1 sigma of people's elevation bias, degrees; ~1 once known"
    )
    body_sigma_m: float = Field(
        default=0.1, ge=0, le=1, description="1 sigma of where the eyes are over the feet, m"
    )
    independent_hz: float = Field(
        default=2.0, gt=0, le=100, description="independent pointings per second, Hz: a hold errs as one"
    )
    min_samples: int = Field(default=20, ge=4, le=8192, description="rays needed, count")
    max_residual_deg: float = Field(
        default=6.0, gt=0, le=90, description="rms angle above which the person did not point, degrees"
    )
    max_position_sigma_m: float = Field(
        default=0.5, gt=0, le=10, description="poses less certain than this are refused, m"
    )
    max_yaw_sigma_deg: float = Field(
        default=6.0, gt=0, le=90, description="poses less certain than this are refused, degrees"
    )

    def trust(self) -> Trust:
        """Return it in radians, for the solver."""
        return Trust(
            ray_sigma_rad=math.radians(self.ray_sigma_deg),
            bias_sigma_rad=math.radians(self.bias_sigma_deg),
            body_sigma_m=self.body_sigma_m,
            independent_hz=self.independent_hz,
            min_samples=self.min_samples,
            max_residual_rad=math.radians(self.max_residual_deg),
            max_position_sigma_m=self.max_position_sigma_m,
            max_yaw_sigma_rad=math.radians(self.max_yaw_sigma_deg),
        )


class LocalizerConfig(Config):
    """How it is found out where the person stands."""

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
        default=(),
        description="static_targets: ids in the order in which they are lit; empty: all of the map",
    )
    reaction_s: float = Field(
        default=1.5,
        ge=0,
        le=30,
        description="static_targets: rays this soon after a lamp lights are skipped, s",
    )
    hold_s: float = Field(
        default=2.0, gt=0, le=60, description="static_targets: rays are gathered for this long per lamp, s"
    )
    patience_s: float = Field(
        default=5.0, ge=0, le=600, description="static_targets: how much longer to wait for missing rays, s"
    )
    robot_id: str = Field(
        default="", description="moving_target: object to follow; empty: the robot that the rays fit best"
    )
    window_s: float = Field(
        default=10.0, gt=1, le=120, description="moving_target: older rays are forgotten, s"
    )
    give_up_s: float = Field(
        default=30.0, gt=1, le=3600, description="moving_target: refused when nothing fits until then, s"
    )
    autostart: bool = Field(
        default=False, description="moving_target: begin at once and go on refining for ever"
    )
    floor_m: Real = Field(default=0.0, description="height of the floor in the room's coordinates, m")
    trust: TrustConfig = TrustConfig()

    def timing(self) -> Timing:
        """Return how long each lamp takes."""
        return Timing(reaction_s=self.reaction_s, hold_s=self.hold_s, patience_s=self.patience_s)

    def following(self) -> Following:
        """Return what is followed, and for how long."""
        return Following(
            target_id=self.robot_id,
            window_s=self.window_s,
            give_up_s=self.give_up_s,
            continuous=self.autostart,
        )
