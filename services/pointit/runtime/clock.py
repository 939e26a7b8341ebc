"""Time as services see it: the wall's, or a simulated one that runs faster or slower."""

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncIterator
from typing import Protocol

from pointit.runtime.bus.contract import Bus, Closable
from pointit.schemas import NS_PER_S, ClockTick
from pointit.schemas.topics import CLOCK

TICK_PERIOD_S = 1.0
"""Period of published simulated time, in wall-clock seconds."""

MAX_AHEAD_S = 2.0
"""A follower ahead by more, in seconds of the wall, has followed another run; one by less is slowed down."""

SILENT_NS = 10 * NS_PER_S
"""After this long without a tick from a regular source, the site has no simulated time any more."""

LOOK_AGAIN_S = 1.0
"""Wall time after which a deadline is checked again, s, since the clock's speed may change."""


MAX_SLEW_S = 10.0
"""Largest step back that is slewed, s of the clock. After a larger one, services step with it, or restart."""


class Clock(Protocol):
    """Source of time for services, which never ask the operating system."""

    @property
    def speed(self) -> float:
        """Return the seconds of this clock per wall-clock second."""
        ...

    def now_ns(self) -> int:
        """Return the time, Unix ns."""
        ...


class WallClock:
    """The operating system's clock."""

    speed = 1.0
    now_ns = staticmethod(time.time_ns)
    """Return the wall time, ns since 1970. Without a frame of its own: it is called for every message."""

    def tick(self) -> ClockTick:
        """Return the tick by which other processes and machines follow."""
        now_ns = time.time_ns()
        return ClockTick(stamp_ns=now_ns, sim_ns=now_ns)


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
        """Return the tick by which other processes follow."""
        return ClockTick(stamp_ns=time.time_ns(), sim_ns=self.now_ns(), speed=self.speed)


class Ticking(Protocol):
    """A clock that others can follow."""

    def tick(self) -> ClockTick:
        """Return the tick by which other processes follow."""
        ...


async def publish_time(clock: Ticking, bus: Bus) -> None:
    """Publish the time of `clock` now and every `TICK_PERIOD_S`, until cancelled."""
    publisher = bus.publisher(CLOCK)
    try:
        while True:
            publisher.put(clock.tick())
            await asyncio.sleep(TICK_PERIOD_S)
    finally:
        publisher.close()


class SiteClock:
    """Follows the simulated time that the site publishes, and wall-clock time while there is none.

    Between ticks it runs on this machine's monotonic clock, so setting the wall clock changes nothing. A tick
    counts from its arrival (network delay is neglected). Only the first, which may have waited for this
    reader, is as old as its stamp says. If a tick shows that this clock is ahead, it runs at half its speed
    until it no longer is: it never goes backwards while it follows one source. It jumps to a tick that is far
    behind, which belongs to another run, and whenever the site's time appears or ends.
    """

    def __init__(self, bus: Bus) -> None:
        self._tick: ClockTick | None = None
        self._count = 0
        self._arrived_ns = 0
        """Monotonic time at which the tick said `_base_ns`."""
        self._base_ns = 0
        self._ahead_ns = 0
        """Lead of this clock at that moment, ns."""
        self._ticked = asyncio.Event()
        self._subscription: Closable = bus.subscribe(CLOCK, self._on_tick)

    @property
    def speed(self) -> float:
        """Return the seconds of this clock per wall-clock second."""
        tick = self._source(time.monotonic_ns())
        return 1.0 if tick is None else tick.speed

    def now_ns(self) -> int:
        """Return the site's time, ns."""
        here_ns = time.monotonic_ns()
        tick = self._source(here_ns)
        return time.time_ns() if tick is None else self._at(tick, here_ns)

    async def wait_for_tick(self, patience_s: float) -> bool:
        """Wait for the site's time. Return True if it came, so that nothing sees the jump towards it."""
        try:
            async with asyncio.timeout(patience_s):
                await self._ticked.wait()
        except TimeoutError:
            return self._ticked.is_set()
        return True

    def close(self) -> None:
        """Follow no longer."""
        self._subscription.close()

    def _source(self, here_ns: int) -> ClockTick | None:
        """Return the tick to follow. None if a regular source has fallen silent, since that run is over."""
        is_over = self._count > 1 and here_ns - self._arrived_ns > SILENT_NS
        return None if is_over else self._tick

    def _at(self, tick: ClockTick, here_ns: int) -> int:
        passed_ns = int((here_ns - self._arrived_ns) * tick.speed)
        return self._base_ns + passed_ns + max(0, self._ahead_ns - passed_ns // 2)

    def _on_tick(self, tick: ClockTick, _name: str) -> None:
        here_ns = time.monotonic_ns()
        before = self._source(here_ns)
        # A first tick that is older than this is not old: its machine's clock is skewed.
        age_ns = 0 if before else min(max(0, time.time_ns() - tick.stamp_ns), SILENT_NS)
        base_ns = tick.sim_ns + int(age_ns * tick.speed)
        ahead_ns = 0 if before is None else self._at(before, here_ns) - base_ns
        goes_on = before is not None and ahead_ns <= MAX_AHEAD_S * tick.speed * NS_PER_S
        self._ahead_ns = max(0, ahead_ns) if goes_on else 0
        self._count = self._count + 1 if goes_on else 1
        self._tick, self._arrived_ns, self._base_ns = tick, here_ns, base_ns
        self._ticked.set()


class SteadyClock:
    """Follows another clock and does not go back, so that what computes with its times need not expect it.

    After the other one was set back, it runs at half speed until both agree again. A step forward passes: to
    a service it looks like a suspension of the machine.
    """

    def __init__(self, clock: Clock, *, may_step: bool = False) -> None:
        """Follow `clock` from now on; `may_step`: also back, by more than `MAX_SLEW_S`."""
        self._clock = clock
        self._may_step = may_step
        self._read_ns = self._now_ns = clock.now_ns()

    @property
    def speed(self) -> float:
        """Return the seconds of this clock per wall-clock second."""
        return self._clock.speed

    def now_ns(self) -> int:
        """Return the time, at least that of the call before, Unix ns."""
        read_ns = self._clock.now_ns()
        if self._now_ns == self._read_ns <= read_ns:
            self._now_ns = self._read_ns = read_ns
            return read_ns
        slowed_ns = self._now_ns + max(0, read_ns - self._read_ns) // 2
        self._read_ns = read_ns
        self._now_ns = max(read_ns, slowed_ns)
        if self._may_step and self._now_ns - read_ns > MAX_SLEW_S * NS_PER_S:
            self._now_ns = read_ns
        return self._now_ns

    def needs_restart(self) -> bool:
        """Return True if the other clock was set back too far to be slewed."""
        return self.now_ns() - self._read_ns > MAX_SLEW_S * NS_PER_S


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


async def wait_until(clock: Clock, deadline_ns: int | None, changed: asyncio.Event) -> None:
    """Wait until `changed` is set, or `clock` shows `deadline_ns`, or `LOOK_AGAIN_S` have passed.

    Args:
        clock: the service's clock.
        deadline_ns: time on `clock`, ns. None: wait for `changed` alone.
        changed: set when the deadline may have changed.
    """
    left_s = None if deadline_ns is None else (deadline_ns - clock.now_ns()) / NS_PER_S / clock.speed
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(None if left_s is None else min(max(0.0, left_s), LOOK_AGAIN_S)):
            await changed.wait()
