"""Timers that are started again."""

import asyncio

from pointit.runtime.clock import Timer
from pointit.runtime.virtual_time import run_virtually


def test_of_several_starts_the_earliest_end_counts_once() -> None:
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
