"""Parameters of robots and of AGVs that cannot work are refused before a bus is opened."""

from typing import Any

import pytest

from pointit.bridges.agv_tracker.service import AgvTracker
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import AnyService, Launch, check_launches
from pointit.services.robot.service import Robot
from pointit.services.robot_replay.service import RobotReplay

AGV = {"broker": "hub", "manufacturer": "acme", "serial_number": "7"}


@pytest.mark.parametrize(
    ("service", "parameters", "problem"),
    [
        (Robot, {"driver": "vda5050"}, "robot.one: broker: is missing"),
        (Robot, {"driver": "vda5050", "vda5050": {"broker": "hub"}}, "robot.one: manufacturer: is missing"),
        (
            Robot,
            {"driver": "ros2", "ros2": {"backend": {"endpoint": "hub"}}},
            "robot.one: backend.endpoint: ",
        ),
        (AgvTracker, {}, "agv-tracker.one: broker: is missing"),
        (AgvTracker, {"broker": "hub", "username": "me", "password_file": "/none"}, "password_file: /none"),
        (RobotReplay, {}, "robot-replay.one: recording: is missing"),
    ],
)
def test_wrong_parameters_are_refused_before_the_service_starts(
    service: type[AnyService], parameters: dict[str, Any], problem: str
) -> None:
    config = service.CONFIG.model_validate(parameters)
    with pytest.raises(ConfigError, match=problem):
        check_launches([Launch(service=service, config=config, name="one")])


@pytest.mark.parametrize("parameters", [{}, {"driver": "vda5050", "vda5050": AGV}, {"driver": "ros2"}])
def test_parameters_that_may_work_are_accepted(parameters: dict[str, Any]) -> None:
    check_launches([Launch(service=Robot, config=Robot.CONFIG.model_validate(parameters), name="one")])
