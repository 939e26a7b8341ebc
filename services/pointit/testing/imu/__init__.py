"""Checks of IMU sources."""

from pointit.testing.imu.checks import IMU_SUITE
from pointit.testing.imu.harness import ImuHarness

__all__ = ["IMU_SUITE", "ImuHarness"]
