"""Processes of a load test, each with a group of services and wrists."""

import asyncio
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch
from pointit_lab.loadtest.network.routers import with_parent

READY_S = 60.0
"""Timeout until all poses are known and so all services run, for many processes on a busy machine."""

STOP_S = 2.0
MAX_LINE = 1024 * 1024 * 1024
"""Limit of an answer, bytes: some 50 for each sample of the people observed."""


@dataclass(kw_only=True)
class Group:
    """Services that run together in one process, and the users whose wrists it drives."""

    name: str
    launches: Sequence[Launch] = ()
    wrists: Sequence[str] = ()
    watched: Sequence[str] = ()
    """Users whose cursors it observes."""
    watches_light: bool = False
    """It observes the frames."""


class Worker:
    """A group in a process of its own."""

    def __init__(self, group: Group, process: asyncio.subprocess.Process) -> None:
        self.group = group
        self.process = process

    @classmethod
    async def start(cls, group: Group, site: str, connect: str, place: Sequence[str] = ()) -> "Worker":
        """Start the process, by the command `place` at another machine, and send it its launches."""
        command = [*place, *with_parent(), sys.executable, "-m", "pointit_lab.loadtest.worker"]
        process = await asyncio.create_subprocess_exec(
            *command,
            limit=MAX_LINE,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            process_group=0,  # a terminal's Ctrl-C is for the parent, which ends its children
        )
        worker = cls(group, process)
        launches = [_dumped(launch) for launch in group.launches]
        task = {
            "site": site,
            "connect": connect,
            "launches": launches,
            "wrists": list(group.wrists),
            "watched": list(group.watched),
            "watches_light": group.watches_light,
        }
        worker.send_line(task)
        return worker

    def send_line(self, message: dict[str, Any]) -> None:
        """Send it `message` as a line of JSON."""
        line = json.dumps(message) + "\n"
        if self.process.stdin is not None:
            self.process.stdin.write(line.encode())

    async def answer(self) -> dict[str, Any]:
        """Return its next line.

        Raises:
            ConfigError: If it has ended.
        """
        line = b""
        if self.process.stdout is not None:
            line = await self.process.stdout.readline()
        if not line:
            raise ConfigError(f"the process of {self.group.name} has ended: see its output above")
        answer: dict[str, Any] = json.loads(line)
        return answer

    async def end(self) -> None:
        """End it."""
        if self.process.stdin is not None:
            self.process.stdin.close()
        try:
            async with asyncio.timeout(STOP_S):
                await self.process.wait()
        except TimeoutError:
            self.process.kill()
            await self.process.wait()


def _dumped(launch: Launch) -> dict[str, Any]:
    """Serialize a launch for a worker."""
    config = launch.config.model_dump(mode="json")
    return {"service": launch.service.NAME, "user": launch.user, "name": launch.name, "config": config}
