"""Checks of drivers of robots."""

from pointit.testing.robot import orders, robot_reconnection
from pointit.testing.robot.harness import ROBOT_SUITE, RobotHarness

__all__ = ["ROBOT_SUITE", "RobotHarness", "orders", "robot_reconnection"]
