"""Readers of a topic, found by the names of its publishers; tasks of a participant."""

import asyncio
import gc

import pytest

from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import RefusedError
from pointit.schemas.topics import CURSOR


async def test_closed_publishers_leave_no_names_behind() -> None:
    broker = LocalBroker()
    bus = MemoryBus(broker)
    readers = broker.readers_of(CURSOR)
    for number in range(1000):
        bus.publisher(CURSOR, f"user{number}").close()
    gc.collect()
    kept = bus.publisher(CURSOR, "anna")
    assert len(readers._by_name) == 1
    kept.close()
    await bus.close()


@pytest.mark.parametrize(("error", "logged"), [(ValueError("oh"), ["look failed"]), (RefusedError("no"), [])])
async def test_tasks_that_fail_are_logged_unless_it_is_a_reply(
    caplog: pytest.LogCaptureFixture, error: Exception, logged: list[str]
) -> None:
    async def fail() -> None:
        raise error

    bus = MemoryBus(LocalBroker())
    await asyncio.wait([bus.spawn(fail(), "look")])
    await asyncio.sleep(0)
    assert [record.message for record in caplog.records] == logged
    await bus.close()
