"""Fixture for every unit test: services report Health more often than once per second."""

import pytest

from pointit.runtime.service import service


@pytest.fixture(autouse=True)
def frequent_health(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have services report often, so that who waits for a report waits for the report alone."""
    monkeypatch.setattr(service, "HEALTH_PERIOD_S", 0.05)
