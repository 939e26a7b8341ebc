"""A simulation: its time, and all processes that ever ran in it."""

import asyncio
from typing import ClassVar

from tests.simulation.kernel.process import Host, Process
from tests.simulation.kernel.timeline import Timeline

FIRST_PID = 1000


class Simulation(Timeline):
    """The world's time and its processes. Patched clocks show the newest one, `current`."""

    current: "ClassVar[Simulation | None]" = None

    def __init__(self, loop: asyncio.AbstractEventLoop, seed: int) -> None:
        """Begin at time 0 on `loop`."""
        super().__init__(loop, seed)
        self.processes: list[Process] = []
        Simulation.current = self

    def start_process(self, name: str, host: Host) -> Process:
        """Return a new process, which runs nothing yet."""
        process = Process(self, name, host, FIRST_PID + len(self.processes))
        self.processes.append(process)
        return process
