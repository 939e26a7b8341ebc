"""Whole `pointit` commands in processes of their own, and an onlooker on their bus."""

import asyncio
import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from pointit.runtime.config.environment_variables import LOG_FORMAT
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, Health, Interaction, Message, StripsFrame, TrackedObjects, topics
from tests.support.bench import until
from tests.support.forked import ForkedProcess
from tests.support.pace import Patience

PATIENCE_S = 60.0
START_S = 0.1
"""Start time of a command on a quiet machine, s."""
_numbers = itertools.count()


def without_page(arguments: Sequence[str]) -> list[str]:
    """Return the arguments of `pointit` for a run without a page, unless they say something of it."""
    is_run = list(arguments[:1]) == ["run"]
    has_page = any("web" in argument for argument in arguments)
    is_explicit = has_page or not {"--lan", "--help"}.isdisjoint(arguments)
    if is_run and not is_explicit:
        return [*arguments, "--no-web"]
    return list(arguments)


@dataclass(frozen=True, kw_only=True)
class Ended:
    code: int
    out: str
    err: str
    took_s: float
    """From the start, or from the signal that ended it."""

    @property
    def sentence(self) -> str:
        _, found, sentence = self.err.rpartition("Error: ")
        assert found, self.err
        return sentence.strip()

    def checked(self, code: int | None) -> "Ended":
        """Fail unless it has ended with `code`, if that is given. Return it."""
        if code is not None:
            assert self.code == code, f"{self.code}: {self.err}"
        return self


class Command:
    """A running command. Its output goes to files, so that it never waits for a reader."""

    def __init__(
        self, arguments: Sequence[str], folder: Path, environment: Mapping[str, str], *, is_forked: bool
    ) -> None:
        """Start it; `is_forked`: `pointit` with these arguments, in a process that has its modules loaded.

        Its output and temporary files are in `folder`; `environment` is added to this process's.
        """
        self._out = folder / f"{next(_numbers)}.out"
        self._err = self._out.with_suffix(".err")
        self._began_s = time.monotonic()
        # the test's own variables, not this machine's
        inherited = dict(os.environ)
        for name in os.environ:
            if name.startswith("POINTIT_") and name not in ("POINTIT_STATE", LOG_FORMAT):
                del inherited[name]
        whole = {**inherited, "TMPDIR": str(folder), **environment}
        self.process: subprocess.Popen[bytes] | ForkedProcess
        with self._out.open("wb") as out, self._err.open("wb") as err:
            if is_forked:
                self.process = ForkedProcess(arguments, self._out, self._err, whole)
            else:
                self.process = subprocess.Popen(
                    arguments, stdin=subprocess.DEVNULL, stdout=out, stderr=err, env=whole,
                    start_new_session=True,
                )  # fmt: skip

    @property
    def out(self) -> str:
        return self._out.read_text(errors="replace")

    @property
    def err(self) -> str:
        return self._err.read_text(errors="replace")

    @property
    def is_running(self) -> bool:
        return self.process.poll() is None

    def logged(self) -> list[str]:
        lines = [line for line in self.err.splitlines() if line.startswith("{")]
        return [json.loads(line)["message"] for line in lines]

    async def says(self, what: str) -> None:
        def has_said() -> bool:
            return what in self.err or what in self.out

        def is_decided() -> bool:
            return has_said() or not self.is_running

        await until(is_decided, PATIENCE_S, f"{what!r} in {self.err}")
        assert has_said(), f"it ended with {self.process.returncode} without saying {what!r}: {self.err}"

    async def end(self, patience_s: float = PATIENCE_S, *, code: int | None = None) -> Ended:
        """Wait until it ends by itself, with `code` if that is given."""
        await self._until_ended(patience_s)
        return self._ended(self._began_s).checked(code)

    async def stop(self, number: int = signal.SIGINT, *, code: int | None = None) -> Ended:
        """Send SIGINT as Ctrl-C does, or another signal; wait for the end, with `code` if that is given."""
        began_s = time.monotonic()
        self.process.send_signal(number)
        await self._until_ended(PATIENCE_S)
        return self._ended(began_s).checked(code)

    async def _until_ended(self, patience_s: float) -> None:
        last_words = self.err[-2000:]
        await until(lambda: not self.is_running, patience_s, f"its end; it says {last_words}")

    def family(self) -> list[psutil.Process]:
        """Return it and all that it has started."""
        me = psutil.Process(self.process.pid)
        return [me, *me.children(recursive=True)]

    def kill(self) -> None:
        with contextlib.suppress(psutil.NoSuchProcess):
            for process in reversed(self.family()):
                with contextlib.suppress(psutil.NoSuchProcess):
                    process.kill()
        self.process.wait(10)

    def _ended(self, began_s: float) -> Ended:
        took_s = time.monotonic() - began_s
        code = self.process.returncode
        assert code is not None
        return Ended(code=code, out=self.out, err=self.err, took_s=took_s)


class Commands:
    """Starts commands and kills those that are left."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._started: list[Command] = []

    def start(self, *arguments: str, environment: Mapping[str, str] | None = None) -> Command:
        """Start `pointit …`. A run has no page, which takes time, unless an argument asks for one.

        It is forked from a process that has loaded its modules, which saves most of the time of a start.
        """
        return self._start(without_page(arguments), environment, is_forked=True)

    def start_program(self, *arguments: str, environment: Mapping[str, str] | None = None) -> Command:
        """Start `pointit …` as a shell does, for tests of its start, its end or its command line."""
        program = [sys.executable, "-m", "pointit"]
        return self.run([*program, *without_page(arguments)], environment)

    def run(self, arguments: Sequence[str], environment: Mapping[str, str] | None = None) -> Command:
        return self._start(arguments, environment, is_forked=False)

    async def pointit(
        self, *arguments: str, environment: Mapping[str, str] | None = None, code: int | None = None
    ) -> Ended:
        """Run `pointit …` to its end, with `code` if that is given."""
        command = self.start(*arguments, environment=environment)
        return await command.end(code=code)

    def _start(
        self, arguments: Sequence[str], environment: Mapping[str, str] | None, *, is_forked: bool
    ) -> Command:
        command = Command(arguments, self._folder, environment or {}, is_forked=is_forked)
        self._started.append(command)
        return command

    def said(self) -> list[str]:
        """Return what each command has written to standard error so far, in the order of their starts."""
        return [command.err for command in self._started]

    def kill_all(self) -> None:
        for command in self._started:
            command.kill()


@dataclass
class Onlooker:
    """The messages of a site as seen by a participant that only observes."""

    bus: ZenohBus
    present: set[str] = field(default_factory=set[str])
    people: set[str] = field(default_factory=set[str])
    health: dict[str, Health] = field(default_factory=dict[str, Health])
    """The newest of each instance."""
    cursors: dict[str, list[Cursor]] = field(default_factory=lambda: defaultdict(list))
    """By user."""
    interactions: dict[str, list[Interaction]] = field(default_factory=lambda: defaultdict(list))
    objects: list[TrackedObjects] = field(default_factory=list[TrackedObjects])
    frames: list[StripsFrame] = field(default_factory=list[StripsFrame])

    def look(self) -> None:
        def on_service(name: str, *, present: bool) -> None:
            change(self.present, name, here=present)

        def on_person(name: str, *, present: bool) -> None:
            change(self.people, name, here=present)

        self.bus.watch(topics.SERVICE_ALIVE, on_service)
        self.bus.watch(topics.USER_ALIVE, on_person)
        self.bus.subscribe(topics.HEALTH, self._on_health)
        self.bus.subscribe(topics.CURSOR, lambda message, user: self.cursors[user].append(message))
        self.bus.subscribe(topics.INTERACTION, lambda message, user: self.interactions[user].append(message))
        self.bus.subscribe(topics.OBJECTS, lambda message, _name: self.objects.append(message))
        self.bus.subscribe(topics.STRIPS_FRAME, lambda message, _name: self.frames.append(message))

    def _on_health(self, health: Health, instance: str) -> None:
        self.health[instance] = health

    async def hears(self, instance: str) -> None:
        await until(lambda: instance in self.health, PATIENCE_S, f"health of {instance}")

    def surfaces(self, user: str) -> set[str]:
        return {cursor.surface_id for cursor in self.cursors[user] if cursor.surface == "strip"}

    def object_ids(self) -> set[str]:
        ids = set[str]()
        for message in self.objects:
            ids.update(thing.id for thing in message.objects)
        return ids

    async def sees_cursors(self, *users: str, patience_s: float = PATIENCE_S) -> None:
        """Wait until each of `users` moves a cursor over a strip from now on."""
        for user in users:
            self.cursors[user].clear()

        def has_all() -> bool:
            return all(self.surfaces(user) for user in users)

        await until(has_all, patience_s, f"cursors of {users}")

    async def sees_more(self, messages: Sequence[Message], what: str) -> None:
        """Wait until more than now of `messages` have come."""
        count = len(messages)
        await until(lambda: len(messages) > count, PATIENCE_S, what)


def change(names: set[str], name: str, *, here: bool) -> None:
    if here:
        names.add(name)
    else:
        names.discard(name)


@contextlib.asynccontextmanager
async def onlooker(endpoint: str, site: str = "lab") -> AsyncGenerator[Onlooker]:
    """Yield an observer of `site`, as soon as the site is there."""
    async with asyncio.timeout(PATIENCE_S):
        bus = await ZenohBus.open(Link(site=site, connect=(endpoint,)))
    seen = Onlooker(bus)
    seen.look()
    try:
        yield seen
    finally:
        await bus.close()


async def start_delay_s(pointit: Callable[..., Awaitable[Ended]]) -> float:
    """Return the extra start time of a command on this machine under its current load, s."""
    ended = await pointit("doctor", "--help")
    return max(0.0, ended.took_s - START_S)


def summary_of(ended: Ended) -> dict[str, Any]:
    summary: dict[str, Any] = json.loads(ended.out)
    return summary


async def doctor_is_content(commands: Commands, endpoint: str) -> None:
    """Ask until all is well: a service that was held up may still say so for a moment."""
    patience = Patience(20)
    while True:
        ended = await commands.pointit("doctor", "--json", "--connect", endpoint)
        report = json.loads(ended.out)
        if ended.code == 0:
            assert report["healthy"] is True
            return
        assert not patience.is_over(), f"doctor still finds {report['findings']}"
