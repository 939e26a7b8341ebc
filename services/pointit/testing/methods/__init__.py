"""Checks of selection methods."""

from pointit.testing.methods.checks import METHOD_SUITE
from pointit.testing.methods.harness import MethodHarness

__all__ = ["METHOD_SUITE", "MethodHarness"]
