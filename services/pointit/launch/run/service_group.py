"""Services that start and stop together: in this process, or as processes of their own."""

import asyncio
import logging
import re
import shlex
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch, run_services
from pointit.schemas.topics import SERVICE_ALIVE
from pointit.services import registry

log = logging.getLogger(__name__)

SECRET = re.compile(r"(token[^=]*=).*", re.DOTALL)
"""An assignment with a secret value."""
STOP_TIMEOUT_S = 1.2
"""Time children get to end before they are killed."""
LAST_WORDS = 2000
"""Bytes at the end of a child's log that are searched for its last error."""


class ServiceGroup:
    """Launches on a bus; `on_end` is called when they end unexpectedly."""

    def __init__(
        self,
        launches: Sequence[Launch],
        bus: Bus,
        clock: Clock,
        *,
        link: Link | None,
        on_end: Callable[[], None],
    ) -> None:
        """Start nothing yet.

        `link`: the link that services in processes of their own join. None: they run in this process,
        and `on_end` is called when they end unexpectedly.
        """
        self.launches = launches
        self._bus = bus
        self._clock = clock
        self._on_end = on_end
        self._work: asyncio.Task[None] | None = None
        self._children: Processes | None = None
        if link is not None:
            self._children = Processes(launches, site=link.site, connect=link.addresses[0])

    @property
    def has_ended(self) -> bool:
        """Return True if all have ended."""
        return self._work is not None and self._work.done()

    def commands(self) -> list[tuple[str, ...]]:
        """Return the command that restarts each launch, without secrets because it is published."""
        if self._children is None:
            return [("pointit", *redact_secrets(sys.argv[1:]))] * len(self.launches)
        return [self._children.command(launch) for launch in self.launches]

    async def begin(self) -> None:
        """Start the services. Return when all are present, or when all processes are started.

        Raises:
            Exception: The error that ended one of them at startup; the others have ended too.
        """
        if self._children is not None:
            await self._children.__aenter__()
            return
        missing = {launch.instance for launch in self.launches}
        settled = asyncio.Event()

        def look(name: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
            if present:
                missing.discard(name)
            if not missing:
                settled.set()

        def ended(_work: asyncio.Task[None]) -> None:
            settled.set()
            self._on_end()

        watching = self._bus.watch(SERVICE_ALIVE, look)
        try:
            running = run_services(self.launches, self._bus, self._clock)
            self._work = asyncio.create_task(running, name="services")
            self._work.add_done_callback(ended)
            if missing:
                await settled.wait()
        finally:
            watching.close()
        self.check()

    def check(self) -> None:
        """Raise the error that ended them, if they have ended.

        Raises:
            Exception: That error.
        """
        if self._work is not None and self._work.done() and not self._work.cancelled():
            self._work.result()

    async def end(self) -> None:
        """Stop and clean up all started services, also those that have ended by themselves."""
        if self._children is not None:
            await self._children.__aexit__(None, None, None)
        if self._work is not None:
            self._work.cancel()
            await asyncio.wait({self._work})


def redact_secrets(arguments: Sequence[str]) -> list[str]:
    """Return the command line `arguments` with secret values removed."""
    return [SECRET.sub(r"\1…", argument) for argument in arguments]


class Processes:
    """Child processes, one per launch; all end on exit of the context.

    A child that ends by itself is reported with the command that restarts it. Restarting it is up to
    the operator, compose or systemd.
    """

    def __init__(
        self, launches: Sequence[Launch], *, site: str, connect: str, clock: Literal["site", "wall"] = "site"
    ) -> None:
        self._launches = launches
        self._site = site
        self._connect = connect
        self._clock = clock
        self._children: dict[str, asyncio.subprocess.Process] = {}
        self._watches: list[asyncio.Task[None]] = []
        self._ending = False
        self.folder = Path(tempfile.mkdtemp(prefix="pointit-"))
        """Holds each service's configuration and log; kept if one of them failed."""

    def command(self, launch: Launch) -> tuple[str, ...]:
        """Return the command that starts `launch`."""
        row = registry.process(launch.service.NAME)
        command = [sys.executable, *row.command, "--config", str(self.folder / f"{launch.instance}.yaml")]
        if launch.user:
            command += ["--user", launch.user]
        if launch.name:
            command += ["--name", launch.name]
        return (*command, "--site", self._site, "--connect", self._connect, "--clock", self._clock)

    async def __aenter__(self) -> Self:
        try:
            for launch in self._launches:
                path = self.folder / f"{launch.instance}.yaml"
                path.write_text(launch.config.model_dump_json(), encoding="utf-8")
            for launch in self._launches:
                await self._start(launch)
        except BaseException:
            await self._end()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self._end()

    async def _end(self) -> None:
        self._ending = True
        failed = [instance for instance, child in self._children.items() if child.returncode is not None]
        waits = [asyncio.create_task(child.wait()) for child in self._children.values()]
        for child in self._children.values():
            if child.returncode is None:
                child.send_signal(signal.SIGTERM)
        if waits:
            await asyncio.wait(waits, timeout=STOP_TIMEOUT_S)
        for instance, child in self._children.items():
            if child.returncode is None:
                log.warning("%s did not end in time and is killed", instance)
                failed.append(instance)
                child.kill()
        await asyncio.gather(*waits)
        pipes = [child.stdin for child in self._children.values() if child.stdin is not None]
        for pipe in pipes:
            pipe.close()  # a pipe that is left to the garbage collector may outlive the loop, which it needs
        await asyncio.gather(*(pipe.wait_closed() for pipe in pipes), return_exceptions=True)
        for watch in self._watches:
            watch.cancel()
        await asyncio.gather(*self._watches, return_exceptions=True)
        if not failed:
            shutil.rmtree(self.folder, ignore_errors=True)

    async def _start(self, launch: Launch) -> None:
        path = self.folder / f"{launch.instance}.log"
        with path.open("ab") as output:
            child = await asyncio.create_subprocess_exec(
                *self.command(launch),
                "--while-parent-lives",
                stdin=asyncio.subprocess.PIPE,
                stdout=output,
                stderr=output,
                process_group=0,  # a terminal's Ctrl-C goes to the parent, which ends the children in order
            )
        self._children[launch.instance] = child
        watch = asyncio.create_task(self._watch(launch, child, path), name=f"watch {launch.instance}")
        self._watches.append(watch)

    async def _watch(self, launch: Launch, child: asyncio.subprocess.Process, path: Path) -> None:
        code = await child.wait()
        if self._ending:
            return
        if code < 0:
            how = f"was ended by {signal.Signals(-code).name}"
        else:
            how = f"ended with exit code {code}"
            if why := last_log_error(path):
                how += f": {why}"
        log.error(
            "%s %s; start it again with: %s (its log: %s)",
            launch.instance,
            how,
            shlex.join(self.command(launch)),
            path,
        )


def last_log_error(path: Path) -> str:
    """Return the last error in a service's log, or else the log's last line."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - LAST_WORDS))
            lines = file.read().decode(errors="replace").strip().splitlines()
    except OSError:
        return ""
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
    return (errors or lines or [""])[-1].rstrip(".")
