"""Parameters of the bridge, and of its trackers."""

import re
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator

from pointit.bridges.ros2.graph.backend import Distro
from pointit.runtime.config.config import Config
from pointit.runtime.config.yaml_file import written_text
from pointit.schemas.topics import check_name

SourceType = Literal[
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "nav_msgs/Odometry",
    "tf",
    "conveyor_msgs/PackageList",
    "vision_msgs/Detection3DArray",
]

TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+\Z")
"""Full name of a topic, an action or a node."""
TF = "tf"
SINGLE: tuple[SourceType, ...] = (
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "nav_msgs/Odometry",
    "tf",
)
"""Types of topics that are about one object each."""

MAX_ROS_USERS = 100
"""Maximum number of ROS-only users; each has a ray, and a check four times a second."""

MAX_TRACKERS = 100
"""Maximum number of trackers, as the site has room for."""


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
        is_tf = self.type == TF
        if is_tf and (self.topic or not self.frame):
            raise ValueError("type tf: give the object's `frame`, as in agv1/base_link, and no topic")
        if not is_tf and not self.topic:
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


class BackendConfig(Config):
    """Connection to the ROS graph."""

    kind: Literal["rmw_zenoh", "dds"] = Field(
        default="rmw_zenoh",
        description="middleware of the ROS nodes: rmw_zenoh, RMW_IMPLEMENTATION=rmw_zenoh_cpp; dds, DDS or "
        "any other middleware of the ROS that is installed and sourced here, by its rclpy (mode and endpoint "
        "do not matter then)",
    )
    mode: Literal["auto", "peer", "client", "router"] = Field(
        default="auto",
        description="peer: as ROS nodes do, and it may start before the router; client: everything through "
        "the router, for a robot across a network; router: be the ROS router itself; auto: peer where a "
        "router answers or has to be on another machine, else router",
    )
    endpoint: str = Field(
        default="tcp/127.0.0.1:7447",
        description="address of the ROS router, or the one to listen at as the router",
    )
    domain_id: int = Field(default=0, ge=0, le=232, description="ROS_DOMAIN_ID of the ROS nodes")
    distro: Distro = Field(
        default="jazzy", description="distribution of the ROS nodes; those from jazzy on hear each other"
    )
    node: str = Field(default="/pointit", description="full name of the bridge's node in the ROS graph")

    @field_validator("node")
    @classmethod
    def _is_full_name(cls, value: str) -> str:
        if not TOPIC.match(value):
            raise ValueError("begin with / and write letters, digits and _, as in /pointit or /site1/pointit")
        return value


class Ros2Config(Config):
    """The ROS graph, and the routes to and from it."""

    backend: BackendConfig = Field(
        default=BackendConfig(), description="connection of the bridge to the ROS graph, and its name there"
    )
    routes: Path | None = Field(
        default=None,
        description="YAML file that changes names and rates of routes, or leaves some out; "
        "`docs/reference/ros2.md` in the repository lists them",
    )
    ros4hri: bool = Field(
        default=False,
        description="also publish people as REP-155 (ROS4HRI) defines, so that pyhri and libhri list them",
    )
    people: tuple[str, ...] = Field(
        default=(),
        max_length=MAX_ROS_USERS,
        description="people without `pointit person add`, as [anna, ben], all of whose nodes are ROS nodes: "
        "their pointing_ray, tf and PUI_subscription are read",
    )
    trackers: dict[str, TrackerConfig] = Field(
        default={},
        max_length=MAX_TRACKERS,
        description="objects that ROS nodes track, by the name of their tracker: topics, or frames of tf",
    )

    @field_validator("trackers")
    @classmethod
    def _have_names(cls, value: dict[str, TrackerConfig]) -> dict[str, TrackerConfig]:
        for name in value:
            check_name(name, "tracker")
        topics = [config.topic for config in value.values() if config.type != TF]
        for topic in topics:
            if topics.count(topic) > 1:
                raise ValueError(f"{topic} is read by two trackers: leave one out")
        return value

    @field_validator("people", mode="before")
    @classmethod
    def _one_is_a_word(cls, value: object) -> object:
        word = written_text(value)
        return (word,) if isinstance(word, str) else value

    @field_validator("people")
    @classmethod
    def _are_names(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for name in value:
            check_name(name, "user")
        if len(set(value)) < len(value):
            raise ValueError("name each person once")
        return value
