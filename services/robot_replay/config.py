"""Parameters of robot-replay."""

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.schemas.base import Name


class RobotReplayConfig(Config):
    """The recording and its start time."""

    recording: str = Field(
        default="", description="CSV file with columns t (s), robot_x, robot_y, robot_z (m)"
    )
    start_ns: int = Field(
        default=0,
        ge=0,
        le=2**62,
        description="time of the recording's first sample, Unix ns; 0: start of the service",
    )
    tracker: Name = Field(default="robot", description="name of the tracker, unique on the site")
    robot_id: str = Field(default="robot", min_length=1, max_length=64, description="id of the robot")
