"""The plug-in `ros2` of robots and its parameters. A driver imports the bridge when it is made."""

import importlib
from typing import Any, Literal

from pydantic import Field, field_validator

from pointit.bridges.ros2.config import SINGLE, TF, TOPIC, BackendConfig, PoseSource
from pointit.plugins import Config, ConfigError, RobotDriver, RobotPlugin, RobotSpec, Surroundings
from pointit.runtime.host.extras import remedy


class RobotBackendConfig(BackendConfig):
    """Connection of a robot's driver to the ROS graph: as another node than that of the bridge."""

    mode: Literal["auto", "peer", "client", "router"] = Field(
        default="peer",
        description="peer: as ROS nodes do; client: everything through the router, for a robot on another "
        "network",
    )
    node: str = Field(
        default="", description="full name of the driver's node; /pointit_ and the robot's name if empty"
    )

    @field_validator("node")
    @classmethod
    def _is_full_name(cls, value: str) -> str:
        if value and not TOPIC.match(value):
            raise ValueError("begin with / and write letters, digits and _, as in /pointit_quad")
        return value


class Ros2RobotConfig(Config):
    """A robot that is a ROS 2 node."""

    backend: RobotBackendConfig = Field(
        default=RobotBackendConfig(),
        description="connection of the driver to the ROS graph, and its name there",
    )
    control: Literal["nav2", "setpoints"] = Field(
        default="nav2",
        description="nav2: goals of the action NavigateToPose; setpoints: PoseStamped for drones",
    )
    action: str = Field(default="/navigate_to_pose", description="nav2: full name of the action")
    setpoint_topic: str = Field(
        default="/mavros/setpoint_position/local", description="setpoints: full name of their topic"
    )
    ground_m: float = Field(default=0.0, ge=-100, le=100, description="setpoints: height of the floor, m")
    frame: str = Field(
        default="map", min_length=1, max_length=150, description="frame in ROS of goals and of reported poses"
    )
    pose: PoseSource = Field(
        default=PoseSource(type=TF, frame="base_link"), description="source of the robot's pose"
    )

    @field_validator("action", "setpoint_topic")
    @classmethod
    def _is_full_topic(cls, value: str) -> str:
        if not TOPIC.match(value):
            raise ValueError("begin with / and write letters, digits, _ and /, as in /agv1/navigate_to_pose")
        return value

    @field_validator("pose")
    @classmethod
    def _is_of_one(cls, value: PoseSource) -> PoseSource:
        if value.type not in SINGLE:
            raise ValueError(f"type: a robot's pose comes from {', '.join(SINGLE)}")
        return value


def _driver() -> Any:
    try:
        return importlib.import_module("pointit.bridges.ros2.robot.driver")
    except ModuleNotFoundError as error:
        needed = error.name
        raise ConfigError(f"driver ros2 needs {needed}: run {remedy('ros2')}") from error


def _make(config: Any, spec: RobotSpec, surroundings: Surroundings) -> RobotDriver:
    driver: RobotDriver = _driver().Ros2Driver(config, spec, surroundings)
    return driver


def _check(config: Any) -> None:
    _driver().check_endpoint(config.backend.endpoint)


ROS2 = RobotPlugin(
    summary="a ROS 2 robot: Nav2 by its action NavigateToPose, or a drone by PoseStamped set-points",
    config=Ros2RobotConfig,
    make=_make,
    check=_check,
)
"""A robot that is a ROS 2 node."""
