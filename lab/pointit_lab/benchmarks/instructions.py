"""Instructions that a sample takes from wrist to light: people in scenario_3, on a bus in memory.

They are counted by Valgrind (`callgrind`) in virtual time, so that other work on the machine changes nothing.
Wrists are included, as is what the services do each second without samples.
"""

import asyncio
import itertools
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from pointit.launch.plan.launches import Choices
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.service.service import run_services
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import Cursor
from pointit.schemas.topics import CURSOR, IMU
from pointit_lab.loadtest.layout import load_launches
from pointit_lab.loadtest.wrist import Wrist, drive_wrists

PEOPLE = 20
RATE_HZ = 100.0
SETTLE_S = 1.0
WARM_UP_S = 0.5
DURATION_S = 1.0
MARK = "getloadavg"
"""C function at each call of which Valgrind writes what it has counted since the last one."""


def measure() -> dict[str, Any]:
    """Return the number of people and samples, and the instructions per sample.

    Raises:
        FileNotFoundError: Valgrind is not installed.
        subprocess.CalledProcessError: The run failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "counts"
        tool = ["valgrind", "--tool=callgrind", f"--dump-before={MARK}", f"--callgrind-out-file={out}"]
        subprocess.run(
            [*tool, sys.executable, "-m", __name__],
            env=os.environ | {"PYTHONHASHSEED": "0", "POINTIT_STATE": folder},
            stderr=subprocess.DEVNULL,  # what Valgrind says of itself
            check=True,
        )
        counted = Path(f"{out}.2").read_text(encoding="utf-8")  # .1: before the first call of MARK
    total = next(int(line.split()[1]) for line in counted.splitlines() if line.startswith("totals:"))
    samples = round(PEOPLE * RATE_HZ * DURATION_S)
    return {"people": PEOPLE, "samples": samples, "per_sample": round(total / samples)}


async def drive() -> int:
    """Run services and wrists, with a call of `MARK` before and after the measured time.

    Return the number of cursors that came meanwhile.
    """
    site, people = load_launches(PEOPLE, choices=Choices(seed=1))
    bus, clock = MemoryBus(LocalBroker()), VirtualClock()
    services = asyncio.create_task(run_services([*site, *itertools.chain(*people.values())], bus, clock))
    cursors: list[Cursor] = []
    bus.subscribe(CURSOR, lambda cursor, _user: cursors.append(cursor))
    wrists = [Wrist(bus.publisher(IMU, user), index, clock) for index, user in enumerate(people)]
    await asyncio.sleep(SETTLE_S)
    await drive_wrists(wrists, RATE_HZ, WARM_UP_S)
    cursors.clear()
    os.getloadavg()
    await drive_wrists(wrists, RATE_HZ, DURATION_S)
    os.getloadavg()
    services.cancel()
    await asyncio.wait({services})
    await bus.close()
    return len(cursors)


if __name__ == "__main__":
    if run_virtually(drive()) < 0.99 * PEOPLE * RATE_HZ * DURATION_S:
        raise SystemExit("cursors are missing")
