"""How busy this machine is: how long things may take is said of a quiet one."""

import subprocess
import sys
import time

START_S = 0.1
"""How long Python takes to start on a quiet machine."""


def slowness() -> float:
    """Return how many times as long as on a quiet machine Python takes to start now; 1 at least."""
    began_s = time.monotonic()
    subprocess.run([sys.executable, "-c", "pass"], check=True, timeout=60)
    return max(1.0, (time.monotonic() - began_s) / START_S)
