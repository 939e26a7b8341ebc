"""Clocks: simulated speed, a site's time in other processes, ticks without drift."""

import asyncio
import itertools
import time
from collections.abc import AsyncIterator

import pytest

from pointit.runtime import Exchange, MemoryBus, SimulatedClock, SiteClock, WallClock
from pointit.runtime.clock import NS_PER_S, sleep, ticks
from pointit.schemas.topics import CLOCK
from tests.support.bench import ManualClock, until


def test_wall_time_is_the_operating_systems() -> None:
    assert abs(WallClock().now_ns() - time.time_ns()) < NS_PER_S
    assert WallClock().speed == 1


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


async def test_a_follower_may_wait_for_the_sites_time_before_it_begins() -> None:
    exchange = Exchange()
    cli, service = MemoryBus(exchange), MemoryBus(exchange)
    follower = SiteClock(service)
    assert not await follower.found(0.01)
    waiting = asyncio.create_task(follower.found(5))
    await asyncio.sleep(0)
    cli.publisher(CLOCK).put(SimulatedClock(10.0).tick())
    assert await waiting
    assert follower.speed == 10.0
    assert await follower.found(0)  # it stays found
    await cli.close()
    await service.close()


async def test_a_site_clock_follows_the_tick_of_another_participant() -> None:
    exchange = Exchange()
    cli, service = MemoryBus(exchange), MemoryBus(exchange)
    source = SimulatedClock(10.0)
    follower = SiteClock(service)
    assert follower.speed == 1.0
    assert abs(follower.now_ns() - time.time_ns()) < NS_PER_S
    publisher = cli.publisher(CLOCK)
    publisher.put(source.tick())
    await until(lambda: follower.speed == 10.0)
    await asyncio.sleep(0.2)  # 2 s of the site
    assert abs(follower.now_ns() - source.now_ns()) < 0.2 * NS_PER_S
    late = SiteClock(service)  # the tick is a state: who comes later follows too
    await until(lambda: late.speed == 10.0)
    follower.close()
    publisher.put(SimulatedClock(3.0).tick())
    await until(lambda: late.speed == 3.0)
    assert follower.speed == 10.0
    await cli.close()
    await service.close()


class FastClock(ManualClock):
    speed = 50.0


async def test_sleep_is_in_the_clocks_seconds() -> None:
    began_s = time.monotonic()
    await sleep(FastClock(), 5.0)
    assert 0.09 < time.monotonic() - began_s < 2.0


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


async def test_missed_ticks_are_skipped_and_the_rest_stay_on_the_grid(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop = StepLoop(monkeypatch)
    came = await take(ticks(ManualClock(), 10), loop, [0.0, 0.55, 0.0, 0.0, 0.0])
    # the work after the second tick (at 0.1) ends at 0.65: one late tick at once, then 0.7, 0.8
    assert came == [0.0, 0.1, 0.65, 0.7, 0.8]


async def test_ticks_follow_the_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = StepLoop(monkeypatch)
    assert await take(ticks(FastClock(), 10), loop, [0.0] * 4) == [0.0, 0.002, 0.004, 0.006]
