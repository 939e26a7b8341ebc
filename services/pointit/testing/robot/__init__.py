"""Checks of drivers of robots."""

from pointit.testing.robot.checks import ROBOT_SUITE
from pointit.testing.robot.harness import RobotHarness

__all__ = ["ROBOT_SUITE", "RobotHarness"]
