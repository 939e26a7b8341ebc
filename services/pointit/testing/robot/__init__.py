"""Checks of drivers of robots."""

from pointit.testing.robot import link, orders
from pointit.testing.robot.harness import ROBOT_SUITE, RobotHarness

__all__ = ["ROBOT_SUITE", "RobotHarness", "link", "orders"]
