"""Harnesses of the selection methods."""

from pointit.services.selector.methods.shipped import FRACTION, GAUGE, HOLD
from pointit.testing.methods import MethodHarness

HOLD_HARNESS = MethodHarness(plugin=HOLD)
FRACTION_HARNESS = MethodHarness(plugin=FRACTION)
GAUGE_HARNESS = MethodHarness(plugin=GAUGE)
