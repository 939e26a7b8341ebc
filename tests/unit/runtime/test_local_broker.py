"""Readers of a topic, found by the names of its publishers."""

import gc

from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
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
