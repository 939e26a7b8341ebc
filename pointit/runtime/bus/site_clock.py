"""Time of a site. Its simulator publishes it, and all other processes follow."""

import asyncio
from typing import Protocol

from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.clock import wait_up_to
from pointit.runtime.machine import this_machine
from pointit.schemas import NS_PER_S, ClockTick
from pointit.schemas.topics import CLOCK

TICK_PERIOD_S = 1.0
"""Period of published simulated time, in wall-clock seconds."""
MAX_AHEAD_S = 2.0
"""Maximum lead of a slowed-down follower, wall-clock s. A larger one comes from another run."""
SILENT_NS = 10 * NS_PER_S
"""Time without a tick of a regular source after which simulated time ends, in wall-clock seconds."""


class Ticking(Protocol):
    """A clock that others can follow."""

    def tick(self) -> ClockTick:
        """Return the tick that other processes follow."""
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
    """Clock that follows the site's simulated time, and wall-clock time while there is none.

    Between ticks it runs on this machine's monotonic clock, so setting the wall clock changes nothing. A tick
    counts from its arrival (network delay is neglected). Only the first tick, which may have been stored for
    this reader, is as old as its stamp. If a tick shows that this clock is ahead, it runs at half its speed
    until it no longer is: it never goes backwards while it follows one source. It jumps to a tick that is far
    behind, which belongs to another run, and whenever the site's time appears or ends.
    """

    def __init__(self, bus: Bus) -> None:
        self._machine = this_machine()
        self._tick: ClockTick | None = None
        self._count = 0
        self._arrived_ns = 0
        """Monotonic time at which the tick `_base_ns` arrived, s."""
        self._base_ns = 0
        self._ahead_ns = 0
        """Lead of this clock at that moment, ns."""
        self._ticked = asyncio.Event()
        self._subscription: Closable = bus.subscribe(CLOCK, self._on_tick)

    @property
    def speed(self) -> float:
        """Return the speed: seconds of this clock per wall-clock second."""
        tick = self._source(self._machine.monotonic_ns())
        return 1.0 if tick is None else tick.speed

    def now_ns(self) -> int:
        """Return the site's time, ns."""
        here_ns = self._machine.monotonic_ns()
        tick = self._source(here_ns)
        return self._machine.now_ns() if tick is None else self._at(tick, here_ns)

    async def wait_for_tick(self, patience_s: float) -> bool:
        """Wait for the site's time, so that no later code sees a jump to it. Return True if it arrived."""
        return await wait_up_to(self._ticked, patience_s)

    def close(self) -> None:
        """Stop following."""
        self._subscription.close()

    def _source(self, here_ns: int) -> ClockTick | None:
        """Return the tick to follow. None if a regular source has fallen silent, since that run is over."""
        is_over = self._count > 1 and here_ns - self._arrived_ns > SILENT_NS
        return None if is_over else self._tick

    def _at(self, tick: ClockTick, here_ns: int) -> int:
        passed_ns = int((here_ns - self._arrived_ns) * tick.speed)
        # a lead is slewed away: half of the time that passes
        lead_ns = max(0, self._ahead_ns - passed_ns // 2)
        return self._base_ns + passed_ns + lead_ns

    def _on_tick(self, tick: ClockTick, _name: str) -> None:
        here_ns = self._machine.monotonic_ns()
        previous = self._source(here_ns)

        # A first tick that is older than this is not old: its machine's clock is skewed.
        age_ns = 0
        if not previous:
            age_ns = min(max(0, self._machine.now_ns() - tick.stamp_ns), SILENT_NS)
        base_ns = tick.sim_ns + int(age_ns * tick.speed)

        # Time never goes back by a tick that came late. It jumps if the site's time was set back.
        ahead_ns = 0 if previous is None else self._at(previous, here_ns) - base_ns
        goes_on = previous is not None and ahead_ns <= MAX_AHEAD_S * tick.speed * NS_PER_S
        self._ahead_ns = max(0, ahead_ns) if goes_on else 0
        self._count = self._count + 1 if goes_on else 1
        self._tick = tick
        self._arrived_ns = here_ns
        self._base_ns = base_ns
        self._ticked.set()
