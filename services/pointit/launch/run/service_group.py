"""Services that start and stop together: in this process, or as processes of their own."""

import asyncio
import re
import sys
from collections.abc import Callable, Sequence

from pointit.launch.run.subprocesses import Processes
from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch, run_services
from pointit.schemas.topics import SERVICE_ALIVE

SECRET = re.compile(r"(token[^=]*=).*", re.DOTALL)
"""An assignment with a secret value."""


class ServiceGroup:
    """Launches on a bus; `on_end` is called when they end unexpectedly."""

    def __init__(
        self,
        launches: Sequence[Launch],
        bus: Bus,
        clock: Clock,
        *,
        processes: Link | None,
        on_end: Callable[[], None],
    ) -> None:
        """Start nothing yet.

        Args:
            launches: the services.
            bus: theirs, if they run in this process.
            clock: of all.
            processes: the link that services in processes of their own join. None: they run in this process.
            on_end: called when services of this process end unexpectedly.
        """
        self.launches = launches
        self._bus = bus
        self._clock = clock
        self._on_end = on_end
        self._work: asyncio.Task[None] | None = None
        self._children: Processes | None = None
        if processes is not None:
            self._children = Processes(launches, site=processes.site, connect=processes.addresses[0])

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
            self._work = asyncio.create_task(
                run_services(self.launches, self._bus, self._clock), name="services"
            )
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
        """Stop and clean up everything that was started, also what has ended by itself."""
        if self._children is not None:
            await self._children.__aexit__(None, None, None)
        if self._work is not None:
            self._work.cancel()
            await asyncio.wait({self._work})


def redact_secrets(arguments: Sequence[str]) -> list[str]:
    """Return the command line `arguments` with secret values removed."""
    return [SECRET.sub(r"\1…", argument) for argument in arguments]
