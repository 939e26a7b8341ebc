"""Checks of services."""

from pointit.testing.service.checks import SERVICE_SUITE
from pointit.testing.service.harness import ServiceHarness, ServiceTrial

__all__ = ["SERVICE_SUITE", "ServiceHarness", "ServiceTrial"]
