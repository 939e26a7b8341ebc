"""Time as services see it: the wall's, or a simulated one that runs faster or slower."""

import asyncio
import math
import time
from collections.abc import AsyncIterator
from typing import Protocol

from pointit.runtime.bus import Bus, Closable
from pointit.schemas import ClockTick
from pointit.schemas.topics import CLOCK

NS_PER_S = 1_000_000_000


class Clock(Protocol):
    """Where services get the time from; nobody else asks the operating system."""

    @property
    def speed(self) -> float:
        """Return how many of its seconds pass in a second of the wall."""
        ...

    def now_ns(self) -> int:
        """Return the time, Unix ns."""
        ...


class WallClock:
    """The operating system's clock."""

    speed = 1.0

    def now_ns(self) -> int:
        """Return the time, Unix ns."""
        return time.time_ns()


class SimulatedClock:
    """Starts at the wall's time and runs `speed` times as fast."""

    def __init__(self, speed: float = 1.0) -> None:
        """Start now.

        Raises:
            ValueError: `speed` is not above 0.
        """
        if not speed > 0:
            raise ValueError(f"a clock's speed must be above 0, got {speed}")
        self.speed = speed
        self._start_ns = time.time_ns()
        self._origin_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the simulated time, ns."""
        return self._start_ns + int((time.monotonic_ns() - self._origin_ns) * self.speed)

    def tick(self) -> ClockTick:
        """Return what lets other processes follow."""
        return ClockTick(stamp_ns=time.time_ns(), sim_ns=self.now_ns(), speed=self.speed)


class SiteClock:
    """Follows the simulated time that the site publishes; the wall's time until it does."""

    def __init__(self, bus: Bus) -> None:
        self._tick: ClockTick | None = None
        self._ticked = asyncio.Event()
        self._subscription: Closable = bus.subscribe(CLOCK, self._on_tick)

    @property
    def speed(self) -> float:
        """Return how many of its seconds pass in a second of the wall."""
        return self._tick.speed if self._tick is not None else 1.0

    def now_ns(self) -> int:
        """Return the site's time, ns."""
        tick = self._tick
        if tick is None:
            return time.time_ns()
        return tick.sim_ns + int((time.time_ns() - tick.stamp_ns) * tick.speed)

    async def found(self, patience_s: float) -> bool:
        """Wait for the site's time; return whether it came, so that nothing sees the jump towards it."""
        try:
            await asyncio.wait_for(self._ticked.wait(), patience_s)
        except TimeoutError:
            return self._ticked.is_set()
        return True

    def close(self) -> None:
        """Follow no longer."""
        self._subscription.close()

    def _on_tick(self, tick: ClockTick, _name: str) -> None:
        self._tick = tick
        self._ticked.set()


async def sleep(clock: Clock, duration_s: float) -> None:
    """Wait until `duration_s` have passed on `clock`."""
    await asyncio.sleep(duration_s / clock.speed)


async def ticks(clock: Clock, rate_hz: float) -> AsyncIterator[int]:
    """Yield the time `rate_hz` times a second of `clock`, without drift; missed ticks are skipped."""
    loop = asyncio.get_running_loop()
    due_s = loop.time()
    while True:
        yield clock.now_ns()
        period_s = 1.0 / (rate_hz * clock.speed)
        late_s = loop.time() - due_s
        due_s += period_s * max(1, math.floor(late_s / period_s))  # on the grid: the last tick that is due
        await asyncio.sleep(max(0.0, due_s - loop.time()))
