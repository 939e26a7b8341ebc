"""Clocks: simulated speed, a site's time in other processes, ticks without drift."""

import asyncio
import itertools
import threading
import time
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.bus import site_clock
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.site_clock import SiteClock, publish_time
from pointit.runtime.clock import MAX_SLEW_S, SimulatedClock, SteadyClock, Timer, ticks
from pointit.runtime.virtual_time import run_virtually
from pointit.schemas import NS_PER_S, ClockTick
from pointit.schemas.topics import CLOCK
from tests.support.bench import ManualClock, until


@pytest.mark.parametrize("speed", [0.1, 1.0, 20.0])
def test_simulated_time_runs_at_its_speed(monkeypatch: pytest.MonkeyPatch, speed: float) -> None:
    now_ns = 0
    monkeypatch.setattr(time, "time_ns", lambda: 1_000 * NS_PER_S + now_ns)
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    clock = SimulatedClock(speed)
    assert clock.now_ns() == 1_000 * NS_PER_S
    now_ns = 3 * NS_PER_S
    assert clock.now_ns() == 1_000 * NS_PER_S + round(3 * speed * NS_PER_S)
    tick = clock.tick()
    assert (tick.stamp_ns, tick.sim_ns, tick.speed) == (1_003 * NS_PER_S, clock.now_ns(), speed)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_time_does_not_stand_still_or_run_backwards(speed: float) -> None:
    with pytest.raises(ValueError, match="above 0"):
        SimulatedClock(speed)


async def test_follower_can_wait_for_the_sites_time() -> None:
    exchange = LocalBroker()
    cli = MemoryBus(exchange)
    service = MemoryBus(exchange)
    follower = SiteClock(service)
    assert not await follower.wait_for_tick(0.01)
    waiting = asyncio.create_task(follower.wait_for_tick(5))
    await asyncio.sleep(0)
    cli.publisher(CLOCK).put(SimulatedClock(10.0).tick())
    assert await waiting
    assert follower.speed == 10.0
    assert await follower.wait_for_tick(0)  # it stays found
    await cli.close()
    await service.close()


class Wall:
    """Stands for the machine's clocks: the monotonic one, and a wall clock that can be set."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.passed_ns = 0
        self.offset_ns = 1_000_000 * NS_PER_S
        monkeypatch.setattr(time, "time_ns", lambda: self.offset_ns + self.passed_ns)
        monkeypatch.setattr(time, "monotonic_ns", lambda: self.passed_ns)

    def step(self, duration_s: float) -> None:
        self.passed_ns += round(duration_s * NS_PER_S)


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    return Wall(monkeypatch)


async def handled() -> None:
    for _ in range(3):
        await asyncio.sleep(0)


async def test_a_site_clock_follows_the_tick_of_another_participant(wall: Wall, bus: MemoryBus) -> None:
    source = SimulatedClock(10.0)
    follower = SiteClock(bus)
    wall.step(2)
    assert (follower.speed, follower.now_ns()) == (1.0, time.time_ns())

    publisher = bus.publisher(CLOCK)
    publisher.put(source.tick())
    await handled()
    assert (follower.speed, follower.now_ns()) == (10.0, source.now_ns())

    wall.step(5)
    assert follower.now_ns() == source.now_ns()
    late = SiteClock(bus)  # the tick is a state: who comes later follows too, although the tick is old
    await handled()
    assert late.now_ns() == source.now_ns()

    follower.close()
    publisher.put(SimulatedClock(3.0).tick())
    await handled()
    assert (follower.speed, late.speed) == (10.0, 3.0)


async def test_setting_the_wall_clock_changes_no_site_time(wall: Wall, bus: MemoryBus) -> None:
    source = SimulatedClock(10.0)
    follower = SiteClock(bus)
    publisher = bus.publisher(CLOCK)
    publisher.put(source.tick())
    await handled()
    for offset_s in (3600, -7200):
        wall.offset_ns += offset_s * NS_PER_S
        assert follower.now_ns() == source.now_ns()
        wall.step(1)
        assert follower.now_ns() == source.now_ns()
        publisher.put(source.tick())
        await handled()
        assert follower.now_ns() == source.now_ns()


async def test_a_clock_that_is_ahead_waits_without_going_backwards(wall: Wall, bus: MemoryBus) -> None:
    """The source's machine has a wall 0.2 s behind: only the first tick is read with it."""
    source = SimulatedClock(10.0)
    follower = SiteClock(bus)
    publisher = bus.publisher(CLOCK)

    async def tick() -> None:
        publisher.put(source.tick().model_copy(update={"stamp_ns": time.time_ns() - NS_PER_S // 5}))
        await handled()

    await tick()
    assert follower.now_ns() - source.now_ns() == 2 * NS_PER_S
    wall.step(1)
    await tick()
    times = [follower.now_ns()]
    errors = [follower.now_ns() - source.now_ns()]
    for _ in range(50):
        wall.step(0.01)
        times.append(follower.now_ns())
        errors.append(follower.now_ns() - source.now_ns())

    assert errors[0] == 2 * NS_PER_S
    assert errors[20] == NS_PER_S
    assert errors[40:] == [0] * 11
    assert {later - earlier for earlier, later in itertools.pairwise(times)} == {
        NS_PER_S // 20,
        NS_PER_S // 10,
    }


async def test_a_restarted_source_is_followed_at_once(wall: Wall, bus: MemoryBus) -> None:
    follower = SiteClock(bus)
    publisher = bus.publisher(CLOCK)
    publisher.put(SimulatedClock(10.0).tick())
    await handled()
    for speed in (10.0, 2.0, 0.5):
        wall.step(60)
        source = SimulatedClock(speed)  # from the wall's time again
        assert follower.now_ns() > source.now_ns()
        publisher.put(source.tick())
        await handled()
        assert (follower.speed, follower.now_ns()) == (speed, source.now_ns())
    wall.step(60)
    source = SimulatedClock(1.5)

    assert follower.now_ns() < source.now_ns()
    publisher.put(source.tick())
    await handled()
    assert follower.now_ns() == source.now_ns()


async def test_a_run_that_is_over_leaves_wall_time(wall: Wall, bus: MemoryBus) -> None:
    follower = SiteClock(bus)
    source = SimulatedClock(10.0)
    publisher = bus.publisher(CLOCK)
    for _ in range(2):
        publisher.put(source.tick())
        await handled()
        wall.step(1)
    wall.step(8.9)
    assert (follower.speed, follower.now_ns()) == (10.0, source.now_ns())
    wall.step(0.2)
    assert (follower.speed, follower.now_ns()) == (1.0, time.time_ns())
    publisher.put(source.tick())  # it was only cut off
    await handled()
    assert (follower.speed, follower.now_ns()) == (10.0, source.now_ns())


async def test_time_is_published_at_once_and_again(monkeypatch: pytest.MonkeyPatch, bus: MemoryBus) -> None:
    monkeypatch.setattr(site_clock, "TICK_PERIOD_S", 0.01)
    told: list[int] = []
    bus.subscribe(CLOCK, lambda tick, _name: told.append(tick.sim_ns))
    keeping = asyncio.create_task(publish_time(SimulatedClock(2.0), bus))
    await until(lambda: len(told) >= 3)
    assert told == sorted(set(told))
    keeping.cancel()
    with pytest.raises(asyncio.CancelledError):
        await keeping
    assert not bus.exchange.states[CLOCK.key]


steps = st.floats(min_value=-7200.0, max_value=7200.0) | st.floats(min_value=0.0, max_value=0.1)


@given(st.lists(steps, max_size=50))
def test_steady_clock_never_goes_back_or_outruns_its_source(moves_s: list[float]) -> None:
    clock = ManualClock()
    steady = SteadyClock(clock)
    time_ns = steady.now_ns()
    for move_s in moves_s:
        clock.advance(move_s)
        before_ns = time_ns
        time_ns = steady.now_ns()
        passed_ns = max(0, round(move_s * 1e9))
        assert passed_ns // 2 <= time_ns - before_ns <= passed_ns
        assert time_ns >= clock.now_ns()
        assert steady.needs_restart() is (time_ns - clock.now_ns() > MAX_SLEW_S * NS_PER_S)


def test_a_steady_clock_runs_at_half_speed_until_both_agree() -> None:
    clock = ManualClock()
    steady = SteadyClock(clock)
    clock.advance(-2.0)
    passed_s: list[float] = []
    for _ in range(50):
        before_ns = steady.now_ns()
        clock.advance(0.1)
        passed_s.append((steady.now_ns() - before_ns) / 1e9)
    assert passed_s == [0.05] * 40 + [0.1] * 10
    assert steady.now_ns() == clock.now_ns()


@pytest.mark.parametrize("back_s", [0.5, MAX_SLEW_S, MAX_SLEW_S + 1.0, 3600.0])
def test_clock_that_may_step_slews_or_steps_without_a_restart(back_s: float) -> None:
    clock = ManualClock()
    stepping = SteadyClock(clock, may_step=True)
    steady = SteadyClock(clock)
    clock.advance(-back_s)
    if back_s > MAX_SLEW_S:
        assert (stepping.now_ns(), steady.needs_restart()) == (clock.now_ns(), True)
        return
    for _ in range(3):
        clock.advance(0.1)
        assert stepping.now_ns() == steady.now_ns() > clock.now_ns()


class FastClock(ManualClock):
    speed = 50.0


class StepLoop:
    """Stands for a loop's time and sleep, so that ticks can be followed exactly."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 100.0
        self.overrun_s = itertools.repeat(0.0)
        self._sleep = asyncio.sleep
        loop = asyncio.get_running_loop()
        monkeypatch.setattr(loop, "time", lambda: self.now_s)
        monkeypatch.setattr(asyncio, "sleep", self.sleep)

    async def sleep(self, duration_s: float) -> None:
        assert duration_s >= 0
        self.now_s += duration_s + next(self.overrun_s)


async def take(ticker: AsyncIterator[int], loop: StepLoop, busy_s: list[float]) -> list[float]:
    """Return when each tick came, s, the work after each taking `busy_s`."""
    came: list[float] = []
    for work_s in busy_s:
        await anext(ticker)
        came.append(round(loop.now_s - 100.0, 9))
        loop.now_s += work_s
    return came


async def test_ticks_do_not_drift_when_sleep_takes_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = StepLoop(monkeypatch)
    loop.overrun_s = itertools.repeat(0.003)
    came = await take(ticks(ManualClock(), 10), loop, [0.01] * 50)
    assert came[0] == 0
    assert came[1:] == [round(0.1 * index + 0.003, 9) for index in range(1, 50)]


async def test_missed_ticks_are_skipped_and_others_stay_on_the_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = StepLoop(monkeypatch)
    came = await take(ticks(ManualClock(), 10), loop, [0.0, 0.55, 0.0, 0.0, 0.0])
    # the work after the second tick (at 0.1) ends at 0.65: one late tick at once, then 0.7, 0.8
    assert came == [0.0, 0.1, 0.65, 0.7, 0.8]


async def test_ticks_follow_the_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = StepLoop(monkeypatch)
    assert await take(ticks(FastClock(), 10), loop, [0.0] * 4) == [0.0, 0.002, 0.004, 0.006]


async def test_tick_of_a_clock_far_behind_is_not_old(wall: Wall, bus: MemoryBus) -> None:
    del wall
    follower = SiteClock(bus)
    bus.publisher(CLOCK).put(ClockTick(stamp_ns=0, sim_ns=5 * NS_PER_S, speed=100.0))
    await handled()
    assert follower.now_ns() <= (5 + 10 * 100) * NS_PER_S


def test_virtual_loop_does_not_wait_for_threads_at_its_end() -> None:
    busy = threading.Event()
    with ThreadPoolExecutor() as pool:

        async def main() -> None:
            asyncio.get_running_loop().set_default_executor(pool)
            pool.submit(busy.wait, 60)

        run_virtually(main())
        busy.set()


def test_timer_started_several_times_ends_once_at_the_earliest() -> None:
    async def ends_s(*waits_s: float) -> list[float]:
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        ends: list[float] = []
        timer = Timer(loop.call_later, lambda: ends.append(round(loop.time() - began_s, 6)))
        for wait_s in waits_s:
            timer.start(wait_s)
        assert timer.is_running
        await asyncio.sleep(10.0)
        assert not timer.is_running
        return ends

    assert run_virtually(ends_s(3.0, 1.0, 2.0)) == [1.0]
    assert run_virtually(ends_s(0.0)) == [0.0]


def test_a_timer_can_be_started_by_its_callback_and_cancelled() -> None:
    async def count() -> int:
        ends: list[float] = []
        loop = asyncio.get_running_loop()

        def on_end() -> None:
            ends.append(loop.time())
            timer.start(1.0)

        timer = Timer(loop.call_later, on_end)
        timer.start(1.0)
        await asyncio.sleep(3.5)
        timer.cancel()
        timer.cancel()
        assert not timer.is_running
        await asyncio.sleep(3.0)
        return len(ends)

    assert run_virtually(count()) == 3


@pytest.mark.parametrize("step_ns", [1, 3, 999])
def test_clock_goes_on_after_a_step_back_however_often_it_is_read(step_ns: int) -> None:
    clock = ManualClock()
    steady = SteadyClock(clock)
    clock.advance(-1.0)
    began_ns = steady.now_ns()

    for _ in range(1000):
        clock.advance(step_ns / NS_PER_S)
        steady.now_ns()

    assert steady.now_ns() - began_ns == 500 * step_ns, "at half speed"
