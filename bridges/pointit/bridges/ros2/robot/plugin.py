"""The plug-in `ros2` of robots: imports what the bridge needs only when a driver is made."""

import importlib
from typing import Any

from pointit.bridges.ros2.robot.config import Ros2RobotConfig
from pointit.plugins import ConfigError, RobotDriver, RobotPlugin, RobotSpec, Surroundings
from pointit.runtime.host.extras import remedy


def _driver() -> Any:
    try:
        return importlib.import_module("pointit.bridges.ros2.robot.driver")
    except ModuleNotFoundError as error:
        raise ConfigError(f"driver ros2 needs {error.name}: run {remedy('ros2')}") from error


def _make(config: Any, spec: RobotSpec, surroundings: Surroundings) -> RobotDriver:
    made: RobotDriver = _driver().Ros2Driver(config, spec, surroundings)
    return made


def _check(config: Any) -> None:
    _driver().check_endpoint(config.backend.endpoint)


ROS2 = RobotPlugin(
    summary="a ROS 2 robot: Nav2 by its action NavigateToPose, or a drone by PoseStamped set-points",
    config=Ros2RobotConfig,
    make=_make,
    check=_check,
)
"""A robot that is a ROS 2 node."""
