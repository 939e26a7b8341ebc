"""`pointit` as a program that prints what it holds: `python -m tests.e2e.run.soaked PERIOD_S ARGUMENT…`.

Each period it writes a line of JSON to standard error: memory, open files, threads, tasks of its event loop.
"""

import asyncio
import json
import sys
import threading
import time
from asyncio.base_events import BaseEventLoop

import psutil

from pointit.__main__ import begin

loops: list[BaseEventLoop] = []
run_forever = BaseEventLoop.run_forever


def noted(loop: BaseEventLoop) -> None:
    loops.append(loop)
    run_forever(loop)


def report(period_s: float) -> None:
    process = psutil.Process()
    began_s = time.monotonic()
    while True:
        time.sleep(period_s)
        tasks = sum(len(asyncio.all_tasks(loop)) for loop in set(loops) if loop.is_running())
        sample = {
            "soak_s": round(time.monotonic() - began_s, 1),
            "memory_mb": round(process.memory_info().rss / 1e6, 1),
            "files": process.num_fds(),
            "threads": process.num_threads(),
            "tasks": tasks,
        }
        sys.stderr.write(json.dumps(sample) + "\n")


if __name__ == "__main__":
    setattr(BaseEventLoop, "run_forever", noted)  # noqa: B010 - types forbid another method
    threading.Thread(target=report, args=(float(sys.argv[1]),), daemon=True).start()
    sys.argv = ["pointit", *sys.argv[2:]]
    begin()
