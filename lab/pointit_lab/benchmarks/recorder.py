"""The recorder: CPU time of its process, and what it costs the run that it records."""

import asyncio
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from pointit.recording.reader import Recording
from pointit.schemas import NS_PER_S
from pointit_lab.benchmarks.statistics import machine
from tests.support.buses import free_port
from tests.support.commands import Command, Commands

SCENARIO = "scenario_4"
PEOPLE = 4
WARM_S = 6.0
ROUNDS = 2
NO_LIMIT_S = "3600"


async def measure(duration_s: float) -> dict[str, Any]:
    """Return shares of a core: of a run alone, recorded by a process, and recording itself, in turns."""
    with tempfile.TemporaryDirectory() as folder:
        commands = Commands(Path(folder))
        try:
            rounds: list[dict[str, float]] = []
            for number in range(ROUNDS):
                rounds.append(await _round(commands, f"{folder}/{number}", duration_s))
        finally:
            commands.kill_all()
    mean: dict[str, float] = {}
    for name in rounds[0]:
        share = statistics.fmean(figures[name] for figures in rounds)
        mean[name] = round(share, 4)
    cost_to_recorded_run = mean["recorded_run"] - mean["run"]
    cost_in_one_process = mean["run_that_records"] - mean["run"]
    load_average, *_ = machine()["load_average"]
    return {
        "scenario": SCENARIO,
        "people": PEOPLE,
        "duration_s": duration_s,
        **mean,
        "cost_to_recorded_run": round(cost_to_recorded_run, 4),
        "cost_in_one_process": round(cost_in_one_process, 4),
        "load_average": load_average,
    }


async def _round(commands: Commands, prefix: str, duration_s: float) -> dict[str, float]:
    # The same run alone, then recorded by a process.
    endpoint, run = _run(commands)
    await asyncio.sleep(WARM_S)
    (alone,) = await _shares(duration_s, run)
    recorder = commands.start("record", f"{prefix}_by_process.mcap", "--connect", endpoint)
    await asyncio.sleep(WARM_S)
    recorded, by_process = await _shares(duration_s, run, recorder)
    await recorder.stop()
    await run.stop()

    # A run that records itself has to be another one: recording begins with the run.
    path = Path(f"{prefix}_in_process.mcap")
    _, run = _run(commands, "--record", str(path))
    await asyncio.sleep(WARM_S)
    (recording,) = await _shares(duration_s, run)
    await run.stop()
    with Recording.open(path) as recording_file:
        length_s = (recording_file.ended_ns - recording_file.began_ns) / NS_PER_S
        messages = sum(recording_file.counts.values())
        size = path.stat().st_size  # noqa: ASYNC240 - nothing else runs here
    bytes_per_s = size / length_s
    return {
        "run": alone,
        "recorded_run": recorded,
        "recorder_process": by_process,
        "run_that_records": recording,
        "messages_per_s": messages / length_s,
        "kbytes_per_s": bytes_per_s / 1e3,
    }


def _run(commands: Commands, *more: str) -> tuple[str, Command]:
    """Return the address of a run, and the run."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    options = ("--users", str(PEOPLE), "--no-web", "--no-view", "--duration", NO_LIMIT_S)
    run = commands.start("run", SCENARIO, *options, "--listen", endpoint, *more)
    return endpoint, run


async def _shares(duration_s: float, *commands: Command) -> list[float]:
    """Return the share of a core that each command takes during `duration_s`."""
    processes = [psutil.Process(command.process.pid) for command in commands]
    before_s = [_cpu_s(process) for process in processes]
    start_s = time.monotonic()
    await asyncio.sleep(duration_s)
    wall_s = time.monotonic() - start_s
    shares: list[float] = []
    for process, cpu_before_s in zip(processes, before_s, strict=True):
        cpu_s = _cpu_s(process) - cpu_before_s
        shares.append(cpu_s / wall_s)
    return shares


def _cpu_s(process: psutil.Process) -> float:
    """Return the time of a process in user and system mode."""
    times = process.cpu_times()
    return times.user + times.system
