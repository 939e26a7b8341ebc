"""Time from `pointit run` to the first light and the first cursor, CPU time and memory."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

RUN_S = 6.0
RUNS = 3
LOOK_S = 0.01
"""Interval at which a run is looked at."""
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""With that variable, which many containers set, each start of a checkout compiles all modules."""


def start(scenario: str = "scenario_3") -> dict[str, Any]:
    """Return seconds from the command, the CPU time to the first light, s, and the peak memory, MB.

    Medians of `RUNS`, after one that is not counted: it may compile modules. At the first light everything is
    loaded and started. Until the first cursor on a surface the simulated person presses the button, searches
    an object and points at it. `first_light_without_queue_s` is `command_to_first_light_s` without the time
    in which the main thread waited for a core that another program had (on Linux; elsewhere they are equal).
    """
    _, *runs = [_run(scenario) for _ in range(RUNS + 1)]
    result: dict[str, Any] = {"scenario": scenario}
    for name in runs[0]:
        median = statistics.median(run[name] for run in runs)
        result[name] = round(median, 3)
    return result


def _run(scenario: str) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        summary_file = Path(folder) / "summary.json"
        command = [sys.executable, "-m", "pointit", "run", scenario]
        command += ["--duration", str(RUN_S), "--no-view", "--summary", str(summary_file)]
        start_s = time.time()
        child = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=ENVIRONMENT
        )

        seen_at, peak_bytes = _watch(child)
        code = child.wait()
        if code:
            raise RuntimeError(f"pointit run ended with {code}")
        text = summary_file.read_text(encoding="utf-8")
        summary = json.loads(text)

    # the look nearest to the first light
    light_s = summary["first_frame_unix_s"]
    nearest_s = min(seen_at, key=lambda at_s: abs(at_s - light_s))
    cpu_s, queued_s = seen_at[nearest_s]
    to_light_s = light_s - start_s
    to_cursor_s = summary["first_cursor_unix_s"] - start_s
    return {
        "command_to_first_light_s": to_light_s,
        "first_light_without_queue_s": to_light_s - queued_s,
        "first_light_cpu_s": cpu_s,
        "command_to_first_cursor_s": to_cursor_s,
        "memory_peak_mb": peak_bytes / 1e6,
    }


def _watch(child: "subprocess.Popen[bytes]") -> tuple[dict[float, tuple[float, float]], int]:
    """Look at a process until it ends.

    Return its CPU time and the queueing time of its main thread, s, by Unix time, s; then its peak memory,
    bytes.
    """
    # Which look is that at the first light is known only from the summary, so all are stored.
    seen_at: dict[float, tuple[float, float]] = {}
    peak_bytes = 0
    while child.poll() is None:
        try:
            process = psutil.Process(child.pid)
            peak_bytes = max(peak_bytes, process.memory_info().rss)
            user_s, system_s, *_ = process.cpu_times()
            queued_s = _queued_s(child.pid)
            seen_at[time.time()] = (user_s + system_s, queued_s)
        except psutil.Error:
            break
        time.sleep(LOOK_S)
    return seen_at, peak_bytes


def _queued_s(pid: int) -> float:
    """Return the time in which the main thread of a process was ready and had no core, or 0 if unknown."""
    try:
        text = Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii")
        _, waited_ns, *_ = text.split()
        return int(waited_ns) / 1e9
    except (OSError, ValueError):
        return 0.0
