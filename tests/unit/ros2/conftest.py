"""The bridge's two halves, wired to a bus in memory and a graph in which there is only the test."""

from collections.abc import AsyncIterator

import pytest

from pointit.bridges.ros2 import service
from tests.unit.ros2.graph_of_one import Bench, FakeBackend, bench
from tests.unit.ros2.scenes import jazzy


@pytest.fixture
async def bridge() -> AsyncIterator[Bench]:
    async with bench(jazzy()) as made:
        yield made


@pytest.fixture
async def eager() -> AsyncIterator[Bench]:
    """Yield a bridge all of whose topics have a reader."""
    async with bench(jazzy(), is_read=True) as made:
        yield made


@pytest.fixture
def backend(monkeypatch: pytest.MonkeyPatch) -> FakeBackend:
    """Return the backend that the service opens as its node in ROS."""
    made = FakeBackend(notes=("no other ROS node is seen",))
    monkeypatch.setattr(service, "NOTED_S", 0.01)

    async def opened(*_: object, **_named: object) -> FakeBackend:
        return made

    monkeypatch.setattr(service, "opened", opened)
    return made
