"""CPU cost of a process that relays messages, and times of round trips through it."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any

import psutil

from pointit_lab.benchmarks.statistics import Figures

TAIL_S = 0.2
"""Time for the last messages to arrive, s."""
LOST_S = 1.0
"""Time after which a round trip counts as lost, s."""


async def relay_cost(
    process: psutil.Process,
    put: Callable[[int], object],
    rate_hz: float,
    duration_s: float,
    *,
    at_once: int = 1,
    per_turn: int = 1,
) -> tuple[int, dict[str, Any]]:
    """Return the number of messages that were put, and what they cost `process`.

    Args:
        process: the relay.
        put: publishes the messages of a turn. It is called with the number of the turn.
        rate_hz: turns per second.
        duration_s: duration of the measurement, s.
        at_once: turns that come in a burst.
        per_turn: messages that `put` publishes.
    """
    before, began_s = process.cpu_times(), time.perf_counter()
    loop, turn = asyncio.get_running_loop(), 0
    due_s = loop.time()
    end_s = due_s + duration_s
    while due_s < end_s:
        for _ in range(at_once):
            put(turn)
            turn += 1
        # no larger bursts to catch up, in which only the newest message would be delivered
        due_s = max(due_s + at_once / rate_hz, loop.time())
        await asyncio.sleep(due_s - loop.time())
    after, took_s = process.cpu_times(), time.perf_counter() - began_s
    await asyncio.sleep(TAIL_S)
    cpu_s = after.user + after.system - before.user - before.system
    messages = turn * per_turn
    return messages, {
        "cpu_share_of_a_core": round(cpu_s / took_s, 4),
        "messages_per_second": round(messages / took_s, 1),
        "us_per_message": round(cpu_s / messages * 1e6, 1) if messages else None,
    }


class RoundTrips:
    """Measures one message after the other."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._came = asyncio.Event()
        self._began_s = 0.0
        self._times_s: list[float] = []

    def on_return(self, _message: object) -> None:
        """Record that the message is back, on any thread."""
        self._times_s.append(time.perf_counter() - self._began_s)
        self._loop.call_soon_threadsafe(self._came.set)

    async def measure(self, send: Callable[[], object], rate_hz: float, count: int) -> dict[str, Any]:
        """Return the times of `count` messages, and how many were lost."""
        for _ in range(count):
            self._came.clear()
            self._began_s = time.perf_counter()
            send()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(LOST_S):
                    await self._came.wait()
            await asyncio.sleep(1.0 / rate_hz)
        return {**Figures.of(self._times_s).as_dict(), "lost": count - len(self._times_s)}
