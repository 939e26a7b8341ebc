"""Checks of LED outputs."""

from pointit.testing.led import frames, led_reconnection
from pointit.testing.led.harness import LED_SUITE, LedHarness

__all__ = ["LED_SUITE", "LedHarness", "frames", "led_reconnection"]
