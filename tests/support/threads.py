"""What each thread of this process does and waits for, for the report of a test that has failed."""

import os
import shutil
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

FRAMES = 8
NATIVE_FRAMES = 25
MOST = 3
"""Number of failed tests of a process for which gdb is asked: it takes seconds."""
_turns = iter(range(MOST))


def thread_states() -> str:
    """Return Python's stacks, what each thread waits for, and the stacks of Zenoh's receiving threads.

    A process whose receiving thread is blocked hears nothing, and no Python is on that thread: where gdb is
    installed, it tells where.
    """
    stacks = ["".join(traceback.format_stack(frame, FRAMES)) for frame in sys._current_frames().values()]
    waits: list[str] = []
    for task in Path("/proc/self/task").glob("*"):
        try:
            waits.append(f"{(task / 'comm').read_text().strip()} {(task / 'wchan').read_text()}")
        except OSError:  # it has ended
            continue
    return "\n".join([*stacks, *waits, *_receiving_threads()])


def _receiving_threads() -> list[str]:
    gdb = shutil.which("gdb")
    if gdb is None or "zenoh" not in sys.modules or next(_turns, None) is None:
        return []
    show = f"thread apply all bt {NATIVE_FRAMES}"
    with tempfile.TemporaryFile("w+") as file:  # nobody reads a pipe: gdb stops this process
        command = [gdb, "-p", str(os.getpid()), "-batch", "-ex", "set width 0", "-ex", show]
        try:
            subprocess.run(command, stdout=file, stderr=subprocess.DEVNULL, check=False, timeout=60)
        except subprocess.TimeoutExpired:
            return ["gdb does not answer"]
        file.seek(0)
        threads = file.read().split("\nThread ")
    return [f"Thread {each}" for each in threads if '"rx-' in each.partition("\n")[0]]
