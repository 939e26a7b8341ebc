"""Parameters of trackers: which ROS topics become objects."""

import re
from typing import Literal

from pydantic import Field, field_validator, model_validator

from pointit.runtime.config.config import Config

TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+\Z")
TF = "tf"

SourceType = Literal[
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "nav_msgs/Odometry",
    "tf",
    "conveyor_msgs/PackageList",
    "vision_msgs/Detection3DArray",
]
SINGLE: tuple[SourceType, ...] = (
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "nav_msgs/Odometry",
    "tf",
)
"""Types of which a topic is about one object."""


class PoseSource(Config):
    """A topic or a tf frame with the position of an object."""

    type: SourceType = Field(
        default="geometry_msgs/PoseStamped",
        description="type of the topic; tf: the pose of a frame by /tf and /tf_static",
    )
    topic: str = Field(default="", description="full name in ROS, as in /agv1/odom; of tf none")
    frame: str = Field(
        default="",
        max_length=150,
        description="of tf: the object's frame, as in agv1/base_link; else the frame of positions if the "
        "header names none, that of the room if empty",
    )
    latency_s: float = Field(
        default=0.0, ge=0, le=10, description="mean time from the measurement to its stamp, s; subtracted"
    )
    stale_s: float = Field(
        default=1.0, gt=0, le=60, description="positions and moving transforms that are older are refused, s"
    )

    @field_validator("topic")
    @classmethod
    def _is_full_name(cls, value: str) -> str:
        if value and not TOPIC.match(value):
            raise ValueError("begin with / and write letters, digits, _ and /, as in /agv1/odom")
        return value

    @model_validator(mode="after")
    def _is_complete(self) -> "PoseSource":
        if self.type == TF and (self.topic or not self.frame):
            raise ValueError("type tf: give the object's `frame`, as in agv1/base_link, and no topic")
        if self.type != TF and not self.topic:
            raise ValueError("topic: is missing; give the full name of one of this type, as in /agv1/odom")
        return self


class TrackerConfig(PoseSource):
    """Objects of one tracker; the parameters' name is the tracker's, `objects/NAME`."""

    id: str = Field(
        default="",
        max_length=64,
        description="the object's id, or the beginning of several objects' ids; the tracker's name if empty",
    )
    kind: str = Field(
        default="", max_length=64, description="kind of its objects; as the topic tells, else robot, if empty"
    )
    size_m: float = Field(
        default=0.0, ge=0, le=100, description="diameter of its objects; as the topic tells if 0, m"
    )
    latency_sigma_s: float | None = Field(
        default=None, ge=0, le=10, description="1 sigma of that latency; unknown if empty, s"
    )
