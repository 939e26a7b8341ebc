"""A service that is started alone keeps the time of its site, whatever its operator forgets."""

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from pointit.runtime import SimulatedClock, keep_time
from pointit.runtime.zenoh_bus import ZenohBus
from pointit.runtime.zenoh_session import Link
from pointit.schemas import Environment
from pointit.schemas.topics import MAP
from tests.support.bench import until
from tests.support.buses import free_port

AHEAD_NS = 10_000 * 1_000_000_000


@asynccontextmanager
async def pui(endpoint: str, *arguments: str) -> AsyncIterator[None]:
    child = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "pointit.services.pui", "--connect", endpoint, *arguments),
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        child.kill()
        await child.wait()


@pytest.mark.parametrize(("arguments", "follows"), [((), True), (("--clock", "wall"), False)])
async def test_a_service_keeps_the_sites_time(arguments: tuple[str, ...], follows: bool) -> None:  # noqa: FBT001
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    bus = await ZenohBus.open(Link(listen=(endpoint,)))
    clock = SimulatedClock(5.0)
    clock._start_ns += AHEAD_NS
    keeping = asyncio.create_task(keep_time(clock, bus))
    maps: list[Environment] = []
    bus.subscribe(MAP, lambda message, _name: maps.append(message))
    before_ns = clock.now_ns()
    async with pui(endpoint, *arguments):
        await until(lambda: bool(maps), 30)
    # put in the constructor: nothing of the service has seen another time
    assert (before_ns <= maps[0].stamp_ns <= clock.now_ns()) is follows
    keeping.cancel()
    await asyncio.gather(keeping, return_exceptions=True)
    await bus.close()
