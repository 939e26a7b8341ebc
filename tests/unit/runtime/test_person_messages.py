"""Sentences of a service to people: told once, advised until replaced, a problem where nobody takes them."""

import asyncio

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.service.person_messages import RETRY_S, UNTOLD, PersonMessages
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas.requests import Done, Say
from pointit.schemas.topics import SAY
from pointit.testing import Bench, in_virtual_time, memory_bench


class Supervisor:
    """Takes sentences to one person."""

    def __init__(self, bench: Bench, user: str) -> None:
        self.received: list[tuple[str, bool, str]] = []
        bench.bus.serve(SAY, self._take, user)

    async def _take(self, query: Say, _name: str) -> Done:
        self.received.append((query.text, query.stays, query.service))
        return Done()


def service_bus(bench: Bench) -> ServiceBus:
    return ServiceBus(bench.bus, bench.clock, "arm", "arm")


@in_virtual_time
async def test_sentence_is_told_each_time_and_advice_once() -> None:
    async with memory_bench(VirtualClock()) as bench:
        supervisor = Supervisor(bench, "anna")
        messages = PersonMessages(service_bus(bench), "arm")
        for _ in range(2):
            messages.advise("anna", "Point at a box.")
            messages.tell("anna", "out of reach")
            await bench.settle()
        advice = ("Point at a box.", True, "arm")
        told = ("out of reach", False, "arm")
        assert supervisor.received == [advice, told, told]


@in_virtual_time
async def test_advice_that_nobody_took_is_sent_again_later() -> None:
    async with memory_bench(VirtualClock()) as bench:
        bus = service_bus(bench)
        messages = PersonMessages(bus, "arm")
        messages.advise("anna", "Point at a box.")
        await bench.settle()
        assert bus.has_warning(UNTOLD, "anna")

        supervisor = Supervisor(bench, "anna")
        messages.advise("anna", "Point at a box.")
        await bench.settle()
        assert supervisor.received == []
        await asyncio.sleep(RETRY_S)
        messages.advise("anna", "Point at a box.")
        await bench.settle()
        assert supervisor.received == [("Point at a box.", True, "arm")]
        assert not bus.has_warning(UNTOLD, "anna")
