"""Checks of LED outputs."""

from pointit.testing.led.checks import LED_SUITE
from pointit.testing.led.harness import LedHarness

__all__ = ["LED_SUITE", "LedHarness"]
