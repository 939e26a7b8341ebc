"""Harness of the method, for tests and `pointit plugin check`. A method has no device."""

from pointit.testing import MethodHarness
from pointit.testing.templates.selection_method import METHOD

DEVICE = MethodHarness(plugin=METHOD, wrong_parameters=({"dwell_s": 0.0},))
