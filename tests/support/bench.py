"""A bench for one or more services: a bus, a clock that stands still until moved, collected output."""

import asyncio
import functools
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, ParamSpec, TypeVar

from pointit.runtime.bus.contract import Bus
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import Clock
from pointit.runtime.config.config import Config
from pointit.runtime.service.service import AnyService, Launch, run_service
from pointit.runtime.virtual_time import is_virtual, run_virtually
from pointit.schemas import Message
from pointit.schemas.topics import ANY, Topic
from tests.support.pace import Patience, VirtualPatience

M = TypeVar("M", bound=Message)
P = ParamSpec("P")

PATIENCE_S = 30.0
"""A condition that comes true ends its wait at once: long patience costs time in a test that fails only."""
SHORTEST_WAIT_S = 0.002
LONGEST_WAIT_S = 0.02
"""Conditions read logs and whole reports. Polled more often, they would slow down what they wait for."""
START_NS = 1_700_000_000_000_000_000


class ManualClock:
    """Stands still until `advance`."""

    speed = 1.0

    def __init__(self, start_ns: int = START_NS) -> None:
        self.time_ns = start_ns

    def now_ns(self) -> int:
        return self.time_ns

    def advance(self, duration_s: float) -> int:
        self.time_ns += round(duration_s * 1e9)
        return self.time_ns


def in_virtual_time(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """Run an asynchronous test in virtual time, in which a busy machine holds nothing up.

    Its clock is a `VirtualClock`.
    """

    @functools.wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        run_virtually(test(*args, **kwargs))

    return run


async def until(
    condition: Callable[[], bool], patience_s: float = PATIENCE_S, what: str | Callable[[], str] = ""
) -> None:
    """Wait for `condition`; fail, saying `what`, if it does not come true in time.

    Args:
        condition: polled every few milliseconds, less often the longer it takes.
        patience_s: time that is enough on a quiet machine. A machine whose cores are all busy may hold up
            another process for seconds, so that less than `PATIENCE_S` counts as `PATIENCE_S`.
        what: description of the condition; a function is called when it has failed.
    """
    patience_s = max(patience_s, PATIENCE_S)
    loop = asyncio.get_running_loop()
    patience = VirtualPatience(patience_s, loop.time) if is_virtual() else Patience(patience_s)
    wait_s = SHORTEST_WAIT_S
    while not condition():
        if patience.is_over():
            sentence = what if isinstance(what, str) else what()
            raise AssertionError(f"waited {patience} in vain{': ' + sentence if sentence else ''}")
        await asyncio.sleep(wait_s)
        wait_s = min(1.1 * wait_s, LONGEST_WAIT_S)


@asynccontextmanager
async def repeated(period_s: float, step: Callable[[], object]) -> AsyncGenerator[None]:
    """Call `step` each period, and await what it returns if that can be awaited."""

    async def repeat() -> None:
        while True:
            result = step()
            if isinstance(result, Awaitable):
                await result
            await asyncio.sleep(period_s)

    async with background(repeat()):
        yield


@asynccontextmanager
async def background(work: Coroutine[Any, Any, None]) -> AsyncGenerator[None]:
    """Run a coroutine beside the block, and cancel it at its end; what failed in it is raised."""
    task = asyncio.create_task(work)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.wait({task})
        if not task.cancelled():
            task.result()


class Bench:
    """A participant beside the services under test: puts, collects, asks."""

    def __init__(self, bus: Bus, clock: Clock) -> None:
        self.bus = bus
        self.clock = clock
        self._publishers: dict[tuple[str, str], Any] = {}
        self._launches: list[asyncio.Task[None]] = []

    def start(
        self, service: type[AnyService], config: Config | None = None, user: str = "", name: str = ""
    ) -> asyncio.Task[None]:
        """Run `service` in the background until the bench is taken down, or `end`."""
        launch = Launch(service=service, config=config or service.CONFIG(), user=user, name=name)
        self._launches.append(asyncio.create_task(run_service(launch, self.bus, self.clock)))
        return self._launches[-1]

    async def end(self, launch: asyncio.Task[None]) -> None:
        self._launches.remove(launch)
        launch.cancel()
        await asyncio.wait([launch])

    def put(self, topic: Topic[M], message: M, name: str = "") -> None:
        key = (topic.key, name)
        if key not in self._publishers:
            self._publishers[key] = self.bus.publisher(topic, name)
        self._publishers[key].put(message)

    def collect(self, topic: Topic[M], name: str = ANY) -> list[M]:
        """Return a list that grows with the messages on `topic`."""
        seen: list[M] = []
        self.bus.subscribe(topic, lambda message, _name: seen.append(message), name)
        return seen

    async def settle(self, rounds: int = 10) -> None:
        """Wait until all messages on their way have arrived and been handled."""
        for _ in range(rounds):
            await asyncio.sleep(0)
        for launch in self._launches:
            if launch.done():
                launch.result()

    async def stop(self) -> None:
        for launch in self._launches:
            launch.cancel()
        results = await asyncio.gather(*self._launches, return_exceptions=True)
        for result in results:
            if isinstance(result, BaseException) and not isinstance(result, asyncio.CancelledError):
                raise result


@asynccontextmanager
async def memory_bench(clock: Clock | None = None) -> AsyncGenerator[Bench]:
    """Yield a bench on a fresh memory bus; fails when a service of it failed."""
    bus = MemoryBus(LocalBroker())
    bench = Bench(bus, clock or ManualClock())
    try:
        yield bench
    finally:
        await bench.stop()
        await bus.close()
