"""Time as services see it: the wall's, or a simulated one at any speed."""

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Callable
from typing import Protocol

from pointit.runtime.machine import this_machine
from pointit.schemas import NS_PER_S, ClockTick

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

    def __init__(self) -> None:
        """Read the clock of this machine."""
        self.now_ns: Callable[[], int] = this_machine().now_ns
        """Return the wall time, ns since 1970. Without a frame of its own: it is called for every message."""

    def tick(self) -> ClockTick:
        """Return the tick by which other processes and machines follow."""
        now_ns = self.now_ns()
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
        self._machine = this_machine()
        self._start_ns = self._machine.now_ns()
        self._origin_ns = self._machine.monotonic_ns()

    def now_ns(self) -> int:
        """Return the simulated time, ns."""
        passed_ns = self._machine.monotonic_ns() - self._origin_ns
        return self._start_ns + int(passed_ns * self.speed)

    def tick(self) -> ClockTick:
        """Return the tick by which other processes follow."""
        return ClockTick(stamp_ns=self._machine.now_ns(), sim_ns=self.now_ns(), speed=self.speed)


class SteadyClock:
    """Follows another clock and does not go back, so that what computes with its times need not expect it.

    After the other one was set back, it runs at half speed until both agree again. A step forward passes: to
    a service it looks like a suspension of the machine.
    """

    def __init__(self, clock: Clock, *, may_step: bool = False) -> None:
        """Follow `clock` from now on; `may_step`: also back, by more than `MAX_SLEW_S`."""
        self._clock = clock
        self._read = clock.now_ns
        self._may_step = may_step
        self._read_ns = self._now_ns = clock.now_ns()
        self._halves_ns = 0
        """Rest of the time that has passed while this clock is slewed, in halves of 1 ns: 0 or 1."""
        self._follows_ns: float = self._now_ns
        """Last reading of the other clock if that is the time, an integer, ns. Infinite while both differ:
        then `_read_ns` and `_now_ns` hold."""

    @property
    def speed(self) -> float:
        """Return the seconds of this clock per wall-clock second."""
        return self._clock.speed

    def now_ns(self) -> int:
        """Return the time, at least that of the call before, Unix ns."""
        read_ns = self._read()
        if read_ns >= self._follows_ns:
            self._follows_ns = read_ns
            return read_ns
        return self._slewed_ns(read_ns)

    def _slewed_ns(self, read_ns: int) -> int:
        if self._follows_ns < math.inf:
            self._now_ns = self._read_ns = int(self._follows_ns)
        # Kept, since each half is lost in readings 1 ns apart, by which the clock would stand still
        halves_ns = self._halves_ns + max(0, read_ns - self._read_ns)
        self._halves_ns = halves_ns % 2
        slowed_ns = self._now_ns + halves_ns // 2
        self._read_ns = read_ns
        self._now_ns = max(read_ns, slowed_ns)
        if self._may_step and self._now_ns - read_ns > MAX_SLEW_S * NS_PER_S:
            self._now_ns = read_ns
        self._follows_ns = read_ns if self._now_ns == read_ns else math.inf
        return self._now_ns

    def needs_restart(self) -> bool:
        """Return True if the other clock was set back too far to be slewed."""
        now_ns = self.now_ns()
        is_far_behind = now_ns - self._read_ns > MAX_SLEW_S * NS_PER_S
        return self._follows_ns == math.inf and is_far_behind


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
    """Wait until `changed` is set, `clock` shows `deadline_ns` (None: never), or `LOOK_AGAIN_S` are over."""
    timeout_s: float | None = None
    if deadline_ns is not None:
        remaining_s = (deadline_ns - clock.now_ns()) / NS_PER_S / clock.speed
        timeout_s = min(max(0.0, remaining_s), LOOK_AGAIN_S)
    await wait_up_to(changed, timeout_s)


async def wait_up_to(event: asyncio.Event, limit_s: float | None) -> bool:
    """Wait until `event` is set, `limit_s` of wall time at most (None: for ever). Return True if it is."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(limit_s):
            await event.wait()
    return event.is_set()


class Timer:
    """Calls back once, some time after it was started. Of several starts the earliest end counts.

    It is what a service uses for "if nothing comes for 2 s": starting it again neither postpones nor repeats
    the call. Cancel it first to postpone.

        timer = Timer(self.bus.call_later, self._on_silence)
        timer.start(2.0)      # calls back in 2 s
        timer.start(5.0)      # changes nothing: 2 s are earlier
        timer.start(1.0)      # calls back in 1 s, and not again in 2
    """

    def __init__(
        self,
        call_later: Callable[[float, Callable[[], None]], asyncio.TimerHandle],
        callback: Callable[[], None],
    ) -> None:
        """Create without starting; `call_later` is that of `ServiceBus` or of the loop."""
        self._call_later = call_later
        self._callback = callback
        self._handle: asyncio.TimerHandle | None = None

    @property
    def is_running(self) -> bool:
        """Return True if it was started and neither has ended nor was cancelled."""
        return self._handle is not None

    def start(self, wait_s: float) -> None:
        """Call back after `wait_s` of wall time, unless it will do so earlier."""
        if self._handle is not None:
            if self._handle.when() <= asyncio.get_running_loop().time() + wait_s:
                return
            self._handle.cancel()
        self._handle = self._call_later(wait_s, self._end)

    def cancel(self) -> None:
        """Call back no longer."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None

    def _end(self) -> None:
        self._handle = None
        self._callback()
