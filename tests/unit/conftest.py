"""Fixtures for unit tests: asynchronous ones run in virtual time; in real time, services report often."""

import asyncio
from collections.abc import Callable

import pytest

from pointit.runtime.service import service
from pointit.runtime.virtual_time import VirtualTimeLoop
from tests.support.buses import bus  # noqa: F401 -- a fixture of the tests


def pytest_asyncio_loop_factories(item: pytest.Item) -> dict[str, Callable[[], asyncio.AbstractEventLoop]]:
    """Return the maker of the loop of a test, in virtual time unless the test is marked `wall_time`."""
    if item.get_closest_marker("wall_time") is not None:
        return {"loop": asyncio.new_event_loop}
    return {"loop": VirtualTimeLoop}


@pytest.fixture(autouse=True)
def frequent_health(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have services report often in real time, so that who waits for a report does not wait for the clock.

    In virtual time that wait costs nothing, and each report costs a millisecond.
    """
    if request.node.get_closest_marker("wall_time") is not None:
        monkeypatch.setattr(service, "HEALTH_PERIOD_S", 0.05)
