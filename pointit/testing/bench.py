"""A bench for tests of services: a bus in memory, a clock that stands still until moved, collected output."""

import asyncio
import functools
from collections.abc import AsyncGenerator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, ParamSpec, TypeVar

from pointit import run_virtually
from pointit.plugins import Clock, Config
from pointit.runtime.bus.contract import Bus
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.service.service import AnyService, Launch, run_service
from pointit.schemas import Message
from pointit.schemas.topics import ANY, Topic

M = TypeVar("M", bound=Message)
P = ParamSpec("P")

TIMEOUT_S = 10.0
"""Longest wait for a condition, s. A condition that comes true ends its wait at once."""
SHORTEST_WAIT_S = 0.002
LONGEST_WAIT_S = 0.02
"""Conditions read logs and whole reports. Polled more often, they would slow down what they wait for."""
START_NS = 1_700_000_000_000_000_000
"""Time at which a `ManualClock` begins, Unix ns."""


class ManualClock:
    """Stands still until `advance`."""

    speed = 1.0

    def __init__(self, start_ns: int = START_NS) -> None:
        self.time_ns = start_ns

    def now_ns(self) -> int:
        """Return the time, Unix ns."""
        return self.time_ns

    def advance(self, duration_s: float) -> int:
        """Move the time forward by `duration_s`, and return it, Unix ns."""
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


class WaitError(AssertionError):
    """A condition has not come true in time."""


async def until(
    condition: Callable[[], bool],
    timeout_s: float = TIMEOUT_S,
    description: str | Callable[[], str] = "",
    is_over: Callable[[], bool] | None = None,
) -> None:
    """Wait until `condition` is true.

    Args:
        condition: polled every few milliseconds, less often the longer it takes.
        timeout_s: longest wait in the loop's time, s.
        description: of the condition, for the error. A function is called when it has failed.
        is_over: ends the wait when it returns True. It replaces `timeout_s`.

    Raises:
        WaitError: If the condition does not come true in time. The message contains `description`.
    """
    # the time of the loop: in virtual time, the wait takes none
    end_s = asyncio.get_running_loop().time() + timeout_s
    wait_s = SHORTEST_WAIT_S
    while not condition():
        if asyncio.get_running_loop().time() > end_s if is_over is None else is_over():
            sentence = description if isinstance(description, str) else description()
            shown = f": {sentence}" if sentence else ""
            raise WaitError(f"waited {timeout_s:g} s in vain{shown}")
        await asyncio.sleep(wait_s)
        wait_s = min(1.1 * wait_s, LONGEST_WAIT_S)


class Bench:
    """A participant beside the services under test: it starts them, puts messages and collects theirs."""

    def __init__(self, bus: Bus, clock: Clock) -> None:
        self.bus = bus
        self.clock = clock
        self._publishers: dict[tuple[str, str], Any] = {}
        self._launches: list[asyncio.Task[None]] = []

    def start(
        self, service: type[AnyService], config: Config | None = None, user: str = "", name: str = ""
    ) -> asyncio.Task[None]:
        """Run `service` in the background until `end` or `stop` is called. Returns its task."""
        launch = Launch(service=service, config=config or service.CONFIG(), user=user, name=name)
        task = asyncio.create_task(run_service(launch, self.bus, self.clock))
        self._launches.append(task)
        return task

    async def end(self, launch: asyncio.Task[None]) -> None:
        """Cancel the service of the task that `start` returned, and wait until it has ended."""
        self._launches.remove(launch)
        launch.cancel()
        await asyncio.wait([launch])

    def put(self, topic: Topic[M], message: M, name: str = "") -> None:
        """Publish `message` on `topic`. `name` replaces the placeholder of its key, such as the person's."""
        key = (topic.key, name)
        if key not in self._publishers:
            self._publishers[key] = self.bus.publisher(topic, name)
        self._publishers[key].put(message)

    def collect(self, topic: Topic[M], name: str = ANY) -> list[M]:
        """Return a list that grows with the messages on `topic`."""
        messages: list[M] = []
        self.bus.subscribe(topic, lambda message, _name: messages.append(message), name)
        return messages

    async def settle(self, rounds: int = 10) -> None:
        """Wait until all messages on their way have arrived and been handled. Raise what a service raised."""
        for _ in range(rounds):
            await asyncio.sleep(0)
        for launch in self._launches:
            if launch.done():
                launch.result()

    async def stop(self) -> None:
        """Cancel all services. Raise the first error of one that failed."""
        for launch in self._launches:
            launch.cancel()
        results = await asyncio.gather(*self._launches, return_exceptions=True)
        for result in results:
            if isinstance(result, BaseException) and not isinstance(result, asyncio.CancelledError):
                raise result


@asynccontextmanager
async def no_task_left() -> AsyncGenerator[None]:
    """Fail if the block leaves tasks running that were not there before it. They are cancelled.

    Raises:
        AssertionError: If there are some. The message contains their names.
    """
    before = asyncio.all_tasks()
    yield
    own = {asyncio.current_task()}
    new_tasks = asyncio.all_tasks() - before - own
    running = [task for task in new_tasks if not task.done()]
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)
    if running:
        names = ", ".join(sorted(task.get_name() for task in running))
        raise AssertionError(f"tasks left running: {names}")


@asynccontextmanager
async def memory_bench(clock: Clock | None = None) -> AsyncGenerator[Bench]:
    """Yield a bench on a fresh bus in memory. Its clock is a `ManualClock` if none is given.

    At the end of the block, its services are cancelled, and the error of one that failed is raised.
    """
    bus = MemoryBus(LocalBroker())
    bench = Bench(bus, clock or ManualClock())
    try:
        yield bench
    finally:
        await bench.stop()
        await bus.close()
