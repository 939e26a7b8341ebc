"""Checks of IMU sources."""

from pointit.testing.imu import link, load, readings
from pointit.testing.imu.harness import IMU_SUITE, ImuHarness

__all__ = ["IMU_SUITE", "ImuHarness", "link", "load", "readings"]
