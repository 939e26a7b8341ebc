"""Checks of LED outputs."""

from pointit.testing.led import frames, link
from pointit.testing.led.harness import LedHarness
from pointit.testing.led.suite import LED_SUITE

__all__ = ["LED_SUITE", "LedHarness", "frames", "link"]
