"""Python calls, files and CPU time from one IMU sample to the LED frame that shows it.

A wrist on one bus, pointing, localizer, pui and led-driver on another, joined over TCP in one process. What
runs without a sample is subtracted. Calls are medians over samples, which the load does not change.
"""

import asyncio
import collections
import itertools
import math
import statistics
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import FrameType
from typing import Any
from unittest import mock

import zenoh
from zenoh.handlers import Callback

from pointit.geometry import rotation
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh import declarations
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ImuSample, StripsFrame
from pointit.schemas.topics import IMU, STRIPS_FRAME
from pointit_lab.benchmarks.our_chain import USER, chain, running_bus

SAMPLES = 100
"""Samples whose calls are counted."""
TIMED_SAMPLES = 1000
"""Samples whose CPU time is measured, without counting."""
PERIOD_S = 0.02
TIMED_PERIOD_S = 0.002
SETTLE_S = 2.0

Work = Callable[[float], Awaitable[None]]
"""Duration, s."""

Calls = collections.Counter[tuple[str, str]]
"""Calls by file and function."""


async def measure(endpoint: str) -> dict[str, Any]:
    """Return calls and files per sample, its CPU time, µs, and the calls by file; `endpoint` must be free."""
    counter = _Counter()
    wrist_bus = await ZenohBus.open(Link(listen=(endpoint,)))
    wrist = wrist_bus.publisher(IMU, USER)
    arm = [rotation.from_azimuth_elevation(0.3 * math.sin(step / 50), -0.02) for step in range(314)]
    seqs = itertools.count()

    def on_frame(frame: StripsFrame, _name: str) -> None:
        """Read frames, as an output does."""

    async def put(period_s: float) -> None:
        seq, stamp_ns = next(seqs), time.time_ns()
        wrist.put(ImuSample(stamp_ns=stamp_ns, seq=seq, orientation_xyzw=arm[seq % len(arm)]))
        await asyncio.sleep(period_s)

    try:
        with mock.patch.object(declarations, "Callback", counter.callback):
            async with running_bus(chain(), Link(connect=(endpoint,))) as bus:
                bus.subscribe(STRIPS_FRAME, on_frame)
                await asyncio.sleep(SETTLE_S)
                for _ in range(SAMPLES):
                    await put(PERIOD_S)
                calls = await counter.medians(put)
                calls.subtract(await counter.medians(_rest))
                used_s, idle_s = await _cpu_s(put), await _cpu_s(_rest)
    finally:
        await wrist_bus.close()
    if not any(file.endswith("services/led_driver/render.py") for file, _ in +calls):
        raise RuntimeError("most samples made no frame in time: other work keeps this machine busy")
    own = {place: count for place, count in (+calls).items() if place[0].startswith("pointit/")}
    return {
        "calls": calls.total(),
        "files": len({file for file, _ in +calls}),
        "own_calls": sum(own.values()),
        "own_files": len({file for file, _ in own}),
        "cpu_us": round((used_s - idle_s) / TIMED_SAMPLES * 1e6, 1),
        "by_function": {f"{file}:{name}": count for (file, name), count in calls.most_common() if count},
    }


async def _rest(period_s: float) -> None:
    """Do nothing."""
    await asyncio.sleep(period_s)


async def _cpu_s(work: Work) -> float:
    """Return the CPU time of this process during `work`, of all its threads."""
    began_s = time.process_time()
    for _ in range(TIMED_SAMPLES):
        await work(TIMED_PERIOD_S)
    return time.process_time() - began_s


class _Counter:
    """Counts Python calls on the loop's thread and on Zenoh's, those of this file left out."""

    def __init__(self) -> None:
        self._calls: Calls = collections.Counter()
        self._is_on = False

    async def medians(self, work: Work) -> Calls:
        """Return the calls during `work`, each the median over `SAMPLES`."""
        each: list[Calls] = []
        self._is_on = True
        sys.setprofile(self._on_event)
        try:
            for _ in range(SAMPLES):
                self._calls = collections.Counter()
                await work(PERIOD_S)
                each.append(self._calls)
        finally:
            sys.setprofile(None)
            self._is_on = False
        places = {place for calls in each for place in calls}
        return collections.Counter(
            {place: statistics.median_high(calls[place] for calls in each) for place in places}
        )

    def callback(self, function: Callable[[zenoh.Sample], None], *, indirect: bool) -> Any:
        """Return Zenoh's callback that calls `function`; its threads begin each callback unprofiled."""

        def counted(sample: zenoh.Sample) -> None:
            if self._is_on:
                sys.setprofile(self._on_event)
            function(sample)

        return Callback(counted, indirect=indirect)

    def _on_event(self, frame: FrameType, event: str, _argument: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename != __file__:
            self._calls[_short(code.co_filename), code.co_qualname] += 1


def _short(file: str) -> str:
    """Return the path of `file` within its package."""
    parts = Path(file).parts
    first = next((n for n, part in enumerate(parts) if part == "pointit"), len(parts) - 2)
    return "/".join(parts[max(0, first) :])
