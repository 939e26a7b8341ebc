"""A site on a free port in this process, and the command line in processes of its own."""

import asyncio
import contextlib
import re
import signal
import sys
import time
from collections.abc import AsyncGenerator
from dataclasses import dataclass, field

from pointit.runtime.clock import WallClock
from pointit.runtime.service.service import AnyService, Launch, run_service
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ImuSample
from pointit.schemas.topics import IMU
from tests.support.bench import until
from tests.support.commands import PATIENCE_S, Ended
from tests.support.forked import run
from tests.support.pace import slowness


@dataclass
class Site:
    """The listening end of the bus, in place of `pointit run`."""

    bus: ZenohBus
    endpoint: str
    present: set[str] = field(default_factory=set[str])
    _tasks: list[asyncio.Task[None]] = field(default_factory=list[asyncio.Task[None]])

    def start(self, service: type[AnyService], user: str = "") -> None:
        self.launch(Launch(service=service, config=service.CONFIG(), user=user))

    def launch(self, *launches: Launch) -> None:
        for launch in launches:
            service = run_service(launch, self.bus, WallClock())
            self._tasks.append(asyncio.create_task(service))

    def feed_imu(self, user: str, rate_hz: float = 50) -> asyncio.Task[None]:
        """Put a level arm's orientation until the end, or until the task is cancelled."""
        feeding = asyncio.create_task(self._feed(user, 1 / rate_hz))
        self._tasks.append(feeding)
        return feeding

    async def _feed(self, user: str, period_s: float) -> None:
        publisher = self.bus.publisher(IMU, user)
        seq = 0
        while True:
            seq += 1
            sample = ImuSample(stamp_ns=time.time_ns(), seq=seq, orientation_xyzw=(0.0, 0.0, 0.0, 1.0))
            publisher.put(sample)
            await asyncio.sleep(period_s)

    @contextlib.asynccontextmanager
    async def python(self, *arguments: str) -> AsyncGenerator[asyncio.subprocess.Process]:
        """Run `python …` on this site; it is killed at the end of the block."""
        process = await asyncio.create_subprocess_exec(
            sys.executable, *arguments, "--connect", self.endpoint, stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.communicate()

    def command(self, *arguments: str) -> contextlib.AbstractAsyncContextManager[asyncio.subprocess.Process]:
        return self.python("-m", "pointit", *arguments)

    async def pointit(self, *arguments: str, code: int | None = None, progress: bool = False) -> Ended:
        """Run `pointit …` to its end, with `code` if that is given.

        Without `progress`, what a command says while a busy machine lets it connect is left out.
        """
        began_s = time.monotonic()
        arguments = (*arguments, "--connect", self.endpoint)
        code_of_end, out, err = await asyncio.to_thread(run, arguments, PATIENCE_S)
        took_s = time.monotonic() - began_s
        if not progress:
            err = re.sub(r"^looking for site .* …\n", "", err)
        ended = Ended(code=code_of_end, out=out, err=err, took_s=took_s)
        return ended.checked(code)

    async def arrived(self, instance: str) -> None:
        await until(lambda: instance in self.present, PATIENCE_S, f"{instance} is present")

    async def stop(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.bus.close()


async def interrupt(process: asyncio.subprocess.Process) -> tuple[int, float]:
    """Send SIGINT as Ctrl-C does. Return the exit code and the time to end, s on a quiet machine."""
    began_s = time.monotonic()
    process.send_signal(signal.SIGINT)
    async with asyncio.timeout(PATIENCE_S):
        code = await process.wait()
        took_s = time.monotonic() - began_s
    return code, took_s / slowness()


async def next_line(stream: asyncio.StreamReader | None) -> str:
    assert stream is not None
    async with asyncio.timeout(PATIENCE_S):
        return (await stream.readline()).decode()
