"""Checks of services."""

from pointit.testing.service import checks
from pointit.testing.service.harness import SERVICE_SUITE, ServiceHarness, ServiceTrial

__all__ = ["SERVICE_SUITE", "ServiceHarness", "ServiceTrial", "checks"]
