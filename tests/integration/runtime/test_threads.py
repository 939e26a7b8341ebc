"""Number of Zenoh's receiving threads, in a process of its own: Zenoh is configured once per process."""

import os
from pathlib import Path

import pytest

from tests.support.buses import free_port
from tests.support.invoked import python

COUNTING = """
import asyncio
from pathlib import Path
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.runtime.zenoh.session import Link
from pointit.schemas.topics import USER_ALIVE

def names():
    found = []
    for task in Path("/proc/self/task").iterdir():
        try:
            found.append((task / "comm").read_text())
        except OSError:
            pass  # it has ended since it was listed
    return found

async def main():
    bus = await ZenohBus.open(Link(listen=("{endpoint}",)))
    client = await ZenohBus.open(Link(connect=("{endpoint}",)))
    # the threads are all begun before the first of them receives anything, and not when the link is open
    come = asyncio.Event()
    bus.watch(USER_ALIVE, lambda name, **_: come.set())
    client.announce(USER_ALIVE, "anna")
    await come.wait()
    while len(set(found := names())) < len(found):
        await asyncio.sleep(0.01)  # a new thread has the name of its creator until it gives itself its own
    print(sum(name.startswith("rx-") for name in found))
    await client.close()
    await bus.close()

asyncio.run(main())
"""


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="Linux tells the names of threads")
@pytest.mark.parametrize(("given", "count"), [("", 1), ("(rx: (worker_threads: 3))", 3)])
def test_one_thread_receives_unless_the_environment_says_otherwise(given: str, count: int) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "ZENOH_RUNTIME"}
    program = COUNTING.format(endpoint=f"tcp/127.0.0.1:{free_port()}")
    done = python("-c", program, env=environment | ({"ZENOH_RUNTIME": given} if given else {}))
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{count}\n", "")
