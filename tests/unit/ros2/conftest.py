"""The bridge's two halves, wired to a bus in memory and a graph in which there is only the test."""

from collections.abc import AsyncIterator

import pytest

from tests.unit.ros2.graph_of_one import Bench, bench
from tests.unit.ros2.scenes import jazzy


@pytest.fixture
async def bridge() -> AsyncIterator[Bench]:
    async with bench(jazzy()) as made:
        yield made


@pytest.fixture
async def eager() -> AsyncIterator[Bench]:
    """Yield a bridge that publishes also what no node subscribes to."""
    async with bench(jazzy(), unread=True) as made:
        yield made
