"""Checks of IMU sources."""

from pointit.testing.imu import link, load, readings
from pointit.testing.imu.harness import ImuHarness
from pointit.testing.imu.suite import IMU_SUITE

__all__ = ["IMU_SUITE", "ImuHarness", "link", "load", "readings"]
