"""Checks of IMU sources."""

from pointit.testing.imu import imu_reconnection, load, readings
from pointit.testing.imu.harness import IMU_SUITE, ImuHarness

__all__ = ["IMU_SUITE", "ImuHarness", "imu_reconnection", "load", "readings"]
