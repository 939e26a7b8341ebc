"""The core in one file: it selects, and what it loads is the smallest part of PointIt that points."""

import subprocess
import sys

from tests.architecture.sources import ROOT

MAX_MODULES = 83
"""Modules of ours that `examples/core.py` loads. It only falls, but for a file that was split."""
LOADED = """
import runpy, sys
runpy.run_path("examples/core.py", run_name="__main__")
print(sum(name.startswith("pointit") for name in sys.modules))
print(*sorted({"zenoh", "click", "rich", "aiohttp"} & {name.partition(".")[0] for name in sys.modules}))
"""


def test_core_selects_without_a_bus_and_loads_little() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOADED], cwd=ROOT, capture_output=True, text=True, check=True
    )
    *lines, count, foreign = done.stdout.split("\n")[:-1]
    assert "1.42 s  anna selected red" in lines
    assert int(count) <= MAX_MODULES
    assert foreign == ""
