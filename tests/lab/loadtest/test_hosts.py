"""Hosts of a load test: what counts for the measurement, and what an observer tells."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.schemas import Cursor
from pointit.schemas.topics import CURSOR
from pointit_lab.loadtest import hosts
from pointit_lab.loadtest.hosts import CONTENTS_S, HostsTest
from pointit_lab.loadtest.network.counters import Contents, Counters
from pointit_lab.loadtest.network.namespaces import Network, Traffic
from pointit_lab.loadtest.network.tree import tree
from pointit_lab.loadtest.sight import DRAIN_S, Sight
from pointit_lab.loadtest.usage import UsageSample
from pointit_lab.loadtest.workers import Group, Worker
from tests.support.bench import START_NS, in_virtual_time, until

Report = Callable[[], float]


class Link(Network):
    """Two machines whose link carries 1000 bytes per second while wrists are driven."""

    driven_s: Report

    def traffic(self) -> dict[int, Traffic]:
        up_bytes = round(1000 * self.driven_s())
        return {1: Traffic(up_bytes=up_bytes, up_packets=0, down_bytes=0, down_packets=0)}


class Driven(Worker):
    """A worker that answers when it has driven its wrists and waited for what still travels."""

    def __init__(self) -> None:
        self.group = Group(name="people 1")
        self.began_s = self.duration_s = 0.0
        self.sight = Sight(frozenset())

    def send_line(self, what: dict[str, Any]) -> None:
        self.began_s, self.duration_s = asyncio.get_running_loop().time(), what.get("duration_s", 0.0)

    def driven_s(self) -> float:
        return min(asyncio.get_running_loop().time() - self.began_s, self.duration_s)

    async def answer(self) -> dict[str, Any]:
        await asyncio.sleep(self.duration_s + DRAIN_S)
        cpu = {"lasted_s": self.duration_s, "cpu_s": 0.5 * self.duration_s, "memory_mb": 1.0}
        return {"sent": 1, "sight": self.sight.dump(), **cpu}


@in_virtual_time
async def test_routers_and_links_are_read_while_wrists_are_driven() -> None:
    worker, network = Driven(), Link(tree(2, 2, 2), "tcp", lacking="a real one")
    network.driven_s = worker.driven_s

    async def started(*_: Any) -> Driven:
        return worker

    async def ready(_: Network) -> Counters:
        return Counters({})

    async def counted(_self: Counters, duration_s: float) -> dict[int, Contents]:
        return {1: Contents(lasted_s=duration_s, counts={"Cursor": [8, 0]})}

    def used(_pid: int | None) -> UsageSample:
        return UsageSample(cpu_s=0.25 * worker.driven_s(), memory_mb=1.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Worker, "start", started)
        patch.setattr(Counters, "start", ready)
        patch.setattr(Counters, "count", counted)
        patch.setattr(hosts, "read_usage", used)
        test = HostsTest(network, {0: [worker.group]}, {0: 1})
        await test.start("lab")
        result = await test.measure(100.0, 1.0, "")
    (link,) = result.links
    assert link.up_bytes_hz == pytest.approx(1000.0)
    assert (link.up_hz, link.counted_s) == ({"Cursor": 8 / CONTENTS_S}, CONTENTS_S)
    assert [usage.cpu for usage in result.processes] == pytest.approx([0.5, 0.25])


async def test_what_is_only_counted_is_told_as_a_number() -> None:
    bus = MemoryBus(LocalBroker())
    sight = Sight(frozenset())
    sight.watch_arrivals(bus)
    publisher = bus.publisher(CURSOR, "load0")
    for seq in range(3):
        publisher.put(Cursor(stamp_ns=START_NS, seq=seq))
    await until(lambda: sight.arrived == 3)
    await bus.close()
    told = sight.dump()
    assert (told["arrived"], told["hovers"]) == (3, 0)
    sum_of = Sight(frozenset())
    sum_of.add(told)
    sum_of.add(told)
    assert sum_of.arrived == 6
    sight.clear()
    assert sight.dump()["arrived"] == 0
