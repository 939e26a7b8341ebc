"""Parameters of the localizer."""

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from pointit.runtime.config.config import Config
from pointit.schemas import UserPose
from pointit.schemas.base import Real, Vec3
from pointit.services.localizer.drift.filter import DriftSettings
from pointit.services.localizer.estimation.estimator import SolverSettings

_SETTINGS = SolverSettings()
_DRIFT = DriftSettings()


def _degrees(angle_rad: float) -> float:
    return round(math.degrees(angle_rad), 6)


def _in_radians(config: Config, *but: str) -> dict[str, Any]:
    """Return the fields of `config` except `but`; those in degrees are converted and named `…_rad…`."""
    fields: dict[str, Any] = {}
    for name, value in config:
        if name in but:
            continue
        if "_deg" in name:
            fields[name.replace("_deg", "_rad")] = math.radians(value)
        else:
            fields[name] = value
    return fields


class TrustConfig(Config):
    """Latency of trackers, and acceptance limits of poses."""

    latency_sigma_s: float = Field(
        default=_SETTINGS.latency_sigma_s,
        ge=0,
        le=10,
        description="moving_target: 1 sigma of the latency of a tracker that does not state it "
        "(`TrackedObjects.latency_sigma_s`), s",
    )
    min_right_probability: float = Field(
        default=_SETTINGS.min_right_probability,
        ge=0,
        lt=1,
        description="moving_target: minimum probability that a person who points at one of eight things, 3 m "
        "away all round, selects it; 0 accepts any pose",
    )
    max_position_sigma_m: float = Field(
        default=_SETTINGS.max_position_sigma_m,
        gt=0,
        le=10,
        description="static_targets: poses less certain than this are refused, m",
    )
    max_yaw_sigma_deg: float = Field(
        default=_degrees(_SETTINGS.max_yaw_sigma_rad),
        gt=0,
        le=90,
        description="static_targets: poses less certain than this are refused, degrees",
    )

    def settings(self) -> SolverSettings:
        """Return the settings of the solver."""
        return SolverSettings(**_in_radians(self))


class StopCriterionConfig(Config):
    """Certainty at which localization by informative lamps ends: both values, or all lamps were used."""

    position_m: float = Field(
        default=0.45,
        gt=0,
        le=10,
        description="1 sigma of the position along its worse direction, m: two times of three the person "
        "stands nearer to what is stated; a pointing errs by 5 degrees, so that 3 to 5 lamps reach 0.45",
    )
    yaw_deg: float = Field(default=7.0, gt=0, le=90, description="1 sigma of the yaw, degrees")


class DriftConfig(Config):
    """Tracking of poses while the IMU's yaw drifts."""

    rate_sigma_degps: float = Field(
        default=_degrees(_DRIFT.rate_sigma_radps),
        gt=0,
        le=10,
        description="1 sigma of an IMU's yaw drift before it is known, degrees/s",
    )
    max_yaw_sigma_deg: float = Field(
        default=15.0,
        gt=0,
        le=180,
        description="health warns if drift makes the yaw less certain than this and as accepted, degrees",
    )

    def settings(self) -> DriftSettings:
        """Return the settings of the filter that tracks the drift of the yaw."""
        return DriftSettings(**_in_radians(self, "max_yaw_sigma_deg"))


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
    steady_degps: float = Field(
        default=8.0,
        ge=0,
        le=360,
        description="static_targets: rays count once they turn no faster, degrees/s; 0: at once",
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
    anchor_at_things: bool | None = Field(
        default=None,
        description="correct a drifting pose by the rays with which the arm lands, once a press confirms the "
        "name that was spoken. If empty, only their elevation",
    )
    floor_m: Real = Field(default=0.0, description="height of the floor in the room's coordinates, m")
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
        return self.trust.settings()
