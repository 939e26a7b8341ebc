"""Nodes of ours in one ROS graph, and strangers beside them."""

from collections.abc import AsyncIterator

import pytest_asyncio
import zenoh

from tests.integration.ros2.nodes import Graphs, Node, graphs


@pytest_asyncio.fixture
async def at() -> AsyncIterator[Graphs]:
    async with graphs() as made:
        yield made


@pytest_asyncio.fixture
async def a(at: Graphs) -> Node:
    """Return a node that is the router."""
    return await at.node("/a", "router")


@pytest_asyncio.fixture
async def b(at: Graphs, a: Node) -> Node:
    """Return a node that joins the graph of `a`."""
    assert a
    return await at.node("/b")


@pytest_asyncio.fixture
async def stranger(at: Graphs, a: Node) -> zenoh.Session:
    """Return a bare client in the graph of `a`, which is of no node."""
    assert a
    return await at.stranger()
