"""Parameters of robot."""

from pydantic import Field, field_validator

from pointit.geometry.floor_sigma import ROBOT_PLACE_SIGMA_M
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import PluginConfig, PluginGroup
from pointit.schemas import RobotKind
from pointit.schemas.base import Vec3
from pointit.services.robot.robot_driver import ROBOTS, RobotPlugin


class FigureConfig(Config):
    """The figure by which people are localized who follow the robot with the arm."""

    duration_s: float = Field(
        default=6.0, gt=1, le=60, description="time of one figure, which is repeated until they are found, s"
    )
    height_m: float = Field(
        default=1.2, gt=0, le=10, description="quadrotor: height to which it takes off for it, m"
    )
    people_m: tuple[Vec3, ...] = Field(
        default=(),
        description="about where those stand who are to be localized, {W}, m; if empty, anywhere around",
    )


class RobotConfig(PluginConfig):
    """The driver of a robot, its size and limits, and when it stops. No safety function."""

    driver: str = Field(
        default="sim",
        description="connection to the robot: sim (a simulated one), or another installed driver; "
        "`pointit plugin list` shows them",
    )
    frame: str = Field(
        default="", description="frame of the map in which the driver gives and takes places; empty for {W}"
    )
    kind: RobotKind = Field(default="ground", description="quadrotor or ground")
    start_m: Vec3 = Field(
        default=(0.0, 0.0, 0.0),
        description="initial position if the robot reports none, in the frame of the driver, m",
    )
    start_yaw_deg: float = Field(default=0.0, ge=-360, le=360, description="azimuth of its front there, °")
    radius_m: float = Field(default=0.25, gt=0, le=5, description="of the circle that it fills, m")
    hover_m: float = Field(
        default=0.2,
        gt=0,
        le=10,
        description="quadrotor: height above a pointed place, and of the take-off, m",
    )
    max_speed_mps: float = Field(default=1.0, gt=0, le=20, description="limit of its speed, m/s")
    max_acceleration_mps2: float = Field(
        default=1.0, gt=0, le=50, description="limit of its acceleration, m/s²"
    )
    max_approach_mps: float = Field(
        default=0.5, gt=0, le=20, description="limit of its speed towards a person, m/s"
    )
    keep_out_m: float = Field(
        default=1.0,
        ge=0,
        le=100,
        description="distance from every person whose place is known, besides 2 sigma of that place, m",
    )
    max_cursor_sigma_m: float = Field(
        default=ROBOT_PLACE_SIGMA_M,
        gt=0,
        le=100,
        description="a cursor or goal whose place is less sure moves nothing, 1 sigma, m",
    )
    aim_sigma_deg: float = Field(
        default=2.0,
        ge=0,
        le=45,
        description="1 sigma of a person's aim in every direction; the uncertainty of a place grows with it, "
        "and with the distance, °",
    )
    reaction_s: float = Field(
        default=0.3,
        gt=0,
        le=10,
        description="time from a command to the robot's brakes, which limits its speed before fences and "
        "people, s",
    )
    cursor_timeout_s: float = Field(
        default=0.3, gt=0, le=10, description="age of a cursor at which a robot that follows it stops, s"
    )
    report_timeout_s: float = Field(
        default=1.0, gt=0, le=60, description="age of its pose at which a robot counts as lost, s"
    )

    latency_sigma_s: float = Field(
        default=0.05,
        ge=0,
        le=10,
        description="1 sigma of the time of its reports, by which localization by this robot is judged, s",
    )
    figure: FigureConfig = FigureConfig()

    @classmethod
    def plugins(cls) -> PluginGroup[RobotPlugin]:
        """Return the installed drivers."""
        return ROBOTS

    @field_validator("driver")
    @classmethod
    def _installed(cls, driver: str) -> str:
        ROBOTS.check_name(driver)
        return driver
