"""Time from `pointit run` to the first light and the first cursor, its memory, and CPU times of starts."""

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
STARTS = 9
COMMANDS = {
    "bare python": ("-c", ""),
    "import pointit": ("-c", "import pointit"),
    "its connect": ("-c", "import pointit; pointit.connect"),
    "pointit --help": ("-m", "pointit.cli", "--help"),
    "pointit run --help": ("-m", "pointit.cli", "run", "--help"),
}
"""Programs to start, by name, as arguments of Python."""


def commands() -> dict[str, float]:
    """Return the CPU time of each of `COMMANDS`, the median of `STARTS` in turn, ms."""
    used_ms: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(STARTS):
        for name, arguments in COMMANDS.items():
            with subprocess.Popen([sys.executable, *arguments], stdout=subprocess.DEVNULL) as child:
                _, status, usage = os.wait4(child.pid, 0)
                child.returncode = os.waitstatus_to_exitcode(status)
            if child.returncode:
                raise RuntimeError(f"{name} ended with {child.returncode}")
            used_ms[name].append(1e3 * (usage.ru_utime + usage.ru_stime))
    return {name: round(statistics.median(values), 1) for name, values in used_ms.items()}


def start(scenario: str = "scenario_3") -> dict[str, Any]:
    """Return seconds from the command, and the peak memory, MB.

    At the first light everything is loaded and started. Until the first cursor on a surface the simulated
    person presses the button, searches an object and points at it.
    """
    with tempfile.TemporaryDirectory() as folder:
        summary = Path(folder) / "summary.json"
        began_s = time.time()
        child = subprocess.Popen(
            [
                *(sys.executable, "-m", "pointit.cli", "run", scenario),
                *("--duration", str(RUN_S), "--no-view", "--summary", str(summary)),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        peak_bytes = 0
        while child.poll() is None:
            try:
                peak_bytes = max(peak_bytes, psutil.Process(child.pid).memory_info().rss)
            except psutil.Error:
                break
            time.sleep(0.1)
        code = child.wait()
        if code:
            raise RuntimeError(f"pointit run ended with {code}")
        seen = json.loads(summary.read_text(encoding="utf-8"))
    return {
        "scenario": scenario,
        "command_to_first_light_s": round(seen["first_frame_unix_s"] - began_s, 3),
        "command_to_first_cursor_s": round(seen["first_cursor_unix_s"] - began_s, 3),
        "memory_peak_mb": round(peak_bytes / 1e6, 1),
    }
