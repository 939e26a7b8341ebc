"""A service that is started alone keeps the time of its site."""

import asyncio

import pytest

from pointit.runtime.bus.site_clock import publish_time
from pointit.runtime.clock import SimulatedClock
from pointit.runtime.link.link import Link
from pointit.runtime.service import process as process_module
from pointit.runtime.service.service import Launch
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Environment
from pointit.schemas.topics import MAP
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from tests.support.bench import until
from tests.support.buses import free_port

AHEAD_NS = 10_000 * 1_000_000_000


@pytest.mark.parametrize(("patience_s", "follows"), [(30.0, True), (None, False)])
async def test_a_service_keeps_the_sites_time_from_its_first_message(
    patience_s: float | None,
    follows: bool,
) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    bus = await ZenohBus.open(Link(listen=(endpoint,)))
    clock = SimulatedClock(5.0)
    clock._start_ns += AHEAD_NS
    maps: list[Environment] = []
    bus.subscribe(MAP, lambda message, _name: maps.append(message))
    launch = Launch(service=Pui, config=PuiConfig())
    link = Link(connect=(endpoint,))
    serving = asyncio.create_task(process_module._serve(launch, link, clock_timeout_s=patience_s))
    await asyncio.sleep(0.1)  # it may well be there before the site has a time
    keeping = asyncio.create_task(publish_time(clock, bus))

    await until(lambda: bool(maps), 30)
    assert (clock._start_ns <= maps[0].stamp_ns <= clock.now_ns()) is follows
    for task in (serving, keeping):
        task.cancel()
    await asyncio.gather(serving, keeping, return_exceptions=True)
    await bus.close()
