"""Instructions that a sample takes from wrist to light: people in scenario_3, on a bus in memory.

They are counted by Valgrind (`callgrind`) in virtual time, so that other work on the machine changes nothing.
Wrists are included, as is what the services do each second without samples.

Instructions alone do not tell the CPU time. Bytecodes are counted beside them: all, and the different ones. A
processor predicts where the interpreter goes next by what went before, and that is lost where a sample passes
too many different ones.

A hop's instructions are the difference between a run of the services before it and one with its service too.
"""

import asyncio
import functools
import itertools
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from pointit.launch.plan.launches import Choices
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.service.service import run_services
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import Message
from pointit.schemas.topics import CURSOR, HOVER, IMU, RAY, STRIPS_FRAME, Topic
from pointit_lab.loadtest.layout import load_launches
from pointit_lab.loadtest.wrist import LoadTestWrist, drive_wrists

PEOPLE = 20
RATE_HZ = 100.0
SETTLE_S = 1.0
WARM_UP_S = 0.5
DURATION_S = 1.0
MARK = "getloadavg"
"""C function at each call of which Valgrind writes what it has counted since the last one."""
HOPS = ("pointing", "localizer", "pui", "selector", "led-driver")
"""Services that a sample passes, in this order; the localizer reads the rays, too."""
COUNTED = (IMU, RAY, CURSOR, HOVER, STRIPS_FRAME)
"""Topics whose messages are counted."""
USUAL = 0.3
"""Bytecodes that fewer of the samples execute are not among the different ones."""


def measure() -> dict[str, Any]:
    """Return people, samples; of a sample: instructions, also by hop, CPU time (µs), bytecodes, messages.

    Raises:
        FileNotFoundError: Valgrind is not installed.
        subprocess.CalledProcessError: A run failed.
    """
    samples = round(PEOPLE * RATE_HZ * DURATION_S)

    # A hop costs what a run with it needs more than one without it and those after it.
    left_out = [HOPS[count:] for count in range(len(HOPS) + 1)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        totals = [total / samples for total in pool.map(_count_instructions, left_out)]
    by_hop: dict[str, int] = {}
    for hop, (without, with_hop) in zip(HOPS, itertools.pairwise(totals), strict=True):
        by_hop[hop] = round(with_hop - without)

    # Each of the others has a run of its own: counting would change the time, and tracing both.
    cpu_us = _measure_cpu_s() / samples * 1e6
    messages = run_virtually(drive(lambda: None, read=COUNTED))
    counter = BytecodeCounter()
    run_virtually(drive(counter.toggle))
    bytecodes = counter.executed.total() / samples
    counts = counter.executed.values()
    different = sum(count >= USUAL * samples for count in counts)
    messages_per_sample: dict[str, float] = {}
    for key, count in messages.items():
        messages_per_sample[key] = round(count / samples, 2)
    return {
        "people": PEOPLE,
        "samples": samples,
        "per_sample": round(totals[-1]),
        "wrists_and_rest": round(totals[0]),
        "by_hop": by_hop,
        "cpu_us": round(cpu_us, 1),
        "bytecodes": round(bytecodes),
        "different": different,
        "messages": messages_per_sample,
    }


def _measure_cpu_s() -> float:
    """Return the CPU time of all samples."""
    times_s: list[float] = []
    run_virtually(drive(lambda: times_s.append(time.thread_time())))
    start_s, end_s = times_s
    return end_s - start_s


def _count_instructions(left_out: Collection[str]) -> int:
    """Return the instructions of all samples, by Valgrind, without the services in `left_out`."""
    with tempfile.TemporaryDirectory() as folder:
        counts = Path(folder) / "counts"
        # the same hashes in each run: the order of sets would change the count
        environment = os.environ | {"PYTHONHASHSEED": "0", "POINTIT_STATE": folder}
        tool = ["valgrind", "--tool=callgrind", f"--dump-before={MARK}", f"--callgrind-out-file={counts}"]
        subprocess.run(
            [*tool, sys.executable, "-m", __name__, *left_out],
            env=environment,
            stderr=subprocess.DEVNULL,  # what Valgrind says of itself
            check=True,
        )
        text = Path(f"{counts}.2").read_text(encoding="utf-8")  # .1: before the first MARK
    totals = [line for line in text.splitlines() if line.startswith("totals:")]
    _, total, *_ = totals[0].split()
    return int(total)


class BytecodeCounter:
    """Counts the bytecodes that this thread executes between two calls of `toggle`."""

    def __init__(self) -> None:
        self.executed = Counter[tuple[CodeType, int]]()
        """By code and place in it."""

    def toggle(self) -> None:
        """Begin to count, or end."""
        sys.settrace(None if sys.gettrace() else self._on_call)

    def _on_call(self, frame: FrameType, event: str, argument: object) -> Callable[..., Any]:
        del event, argument
        frame.f_trace_lines = False
        frame.f_trace_opcodes = True
        return self._on_event

    def _on_event(self, frame: FrameType, event: str, argument: object) -> Callable[..., Any]:
        del argument
        if event == "opcode":
            self.executed[frame.f_code, frame.f_lasti] += 1
        return self._on_event


async def drive(
    mark: Callable[[], object], left_out: Collection[str] = (), read: Sequence[Topic[Any]] = (CURSOR,)
) -> Counter[str]:
    """Run services and wrists, with a call of `mark` before and after the measured time.

    Return the messages of the topics in `read` meanwhile, by key. Services in `left_out` do not run.
    """
    site, people = load_launches(PEOPLE, choices=Choices(seed=1))
    all_launches = itertools.chain(site, *people.values())
    launches = [launch for launch in all_launches if launch.service.NAME not in left_out]
    bus = MemoryBus(LocalBroker())
    clock = VirtualClock()
    services = asyncio.create_task(run_services(launches, bus, clock))
    messages = Counter[str]()

    def count(message: Message, _name: str, *, key: str) -> None:
        del message
        messages[key] += 1

    for topic in read:
        bus.subscribe(topic, functools.partial(count, key=topic.key))
    wrists: list[LoadTestWrist] = []
    for index, user in enumerate(people):
        publisher = bus.publisher(IMU, user)
        wrists.append(LoadTestWrist(publisher, index, clock))
    await asyncio.sleep(SETTLE_S)
    await drive_wrists(wrists, RATE_HZ, WARM_UP_S)

    # The warm-up has filled the caches, so only what repeats with each sample is between the marks.
    messages.clear()
    mark()
    await drive_wrists(wrists, RATE_HZ, DURATION_S)
    mark()
    services.cancel()
    await asyncio.wait({services})
    await bus.close()
    return messages


if __name__ == "__main__":
    left_out = sys.argv[1:]
    messages = run_virtually(drive(os.getloadavg, left_out))
    least = 0.99 * PEOPLE * RATE_HZ * DURATION_S
    if not left_out and messages[CURSOR.key] < least:
        raise SystemExit("cursors are missing")
