"""The programs of `pointit run --on`, which are started when people point at things."""

import asyncio
import contextlib
import logging
import os
import re
import shlex
import shutil
import signal
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import click

from pointit.api.reactions import check_things, is_reaction
from pointit.cli.common.run_part import Added, RunPart
from pointit.cli.display.display_part import DisplayPart
from pointit.launch.plan.launches import Choices, site_launches
from pointit.launch.plan.scenario import Scenario
from pointit.launch.plan.scenario_catalog import room_of
from pointit.launch.plan.watcher import News
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.config.similar_names import nearest
from pointit.runtime.errors import ConfigError
from pointit.schemas import Environment, SelectionEvent
from pointit.schemas.topics import SELECTION_EVENTS

log = logging.getLogger(__name__)

MAX_PROGRAMS = 8
"""Maximum number of programs at a time. What would start further ones is dropped, and counts as a failure."""
MAX_S = 60.0
"""Time after which a program is ended, s."""
GRACE_S = 1.0
"""Time from SIGTERM to SIGKILL, s."""
MAX_FAILURES = 20
"""Number of last failures in the summary. Earlier ones are only counted."""

PLACEHOLDER = re.compile(r"\{(\w+)\}")
PLACEHOLDERS = ("thing", "user", "confidence", "state")


@dataclass(frozen=True, kw_only=True)
class Command:
    """The program of a thing."""

    thing: str
    arguments: Sequence[str]
    """Program and arguments, with placeholders."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the command in `THING=PROGRAM ARGUMENTS...`, quoted as in a shell.

        Raises:
            ConfigError: If it is none, has an unknown placeholder, or there is no such program.
        """
        thing, _, line = text.partition("=")
        try:
            arguments = shlex.split(line)
        except ValueError as error:
            raise ConfigError(f"--on {text!r}: {str(error).lower()}; close it") from error
        if not thing or not arguments:
            raise ConfigError(f"--on {text!r}: write THING=PROGRAM, such as 'screws=./order.sh {{user}}'")
        for name in PLACEHOLDER.findall(line):
            if name not in PLACEHOLDERS:
                raise ConfigError(f"--on {thing}: there is no {{{name}}}; {nearest(name, PLACEHOLDERS)}")
        program = arguments[0]
        if not PLACEHOLDER.search(program) and shutil.which(program) is None:
            raise ConfigError(f"--on {thing}: no program {program}; give a path, and `chmod +x` a script")
        return cls(thing=thing.strip(), arguments=arguments)

    def check(self, room: Environment) -> None:
        """Check that the map has the thing. Raises ConfigError."""
        try:
            check_things([self.thing], room)
        except ConfigError as error:
            raise ConfigError(f"--on {self.thing}: {error}") from error

    def filled(self, event: SelectionEvent) -> list[str]:
        """Return program and arguments for an event. An unknown confidence is empty."""
        values = {
            "thing": event.thing,
            "user": event.user,
            "confidence": "" if event.confidence is None else f"{event.confidence:.2f}",
            "state": "on" if event.is_on else "off",
        }
        return [PLACEHOLDER.sub(lambda match: values[match[1]], argument) for argument in self.arguments]


class Programs:
    """Watcher of a run that starts programs, and ends them with the scenario."""

    def __init__(self, commands: Sequence[Command]) -> None:
        """Start those of `commands` whose thing is pointed at."""
        self._commands = commands
        self._room: Environment | None = None
        self._running = set[asyncio.Task[None]]()
        self._started = 0
        self._failed = 0
        self._failures: deque[str] = deque(maxlen=MAX_FAILURES)

    def attach(self, bus: Bus, news: News) -> Sequence[Closable]:
        """Subscribe on `bus`. Return the subscription, and what ends all programs."""
        del news
        ending = contextlib.ExitStack()
        ending.callback(self._end)
        return ending, bus.subscribe(SELECTION_EVENTS, self._on_event)

    def on_map(self, environment: Environment) -> None:
        """Update the things, and report those that it lacks."""
        self._room = environment
        for command in self._commands:
            try:
                command.check(environment)
            except ConfigError as error:
                self._fail(str(error))

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Ignore services."""

    def summary(self) -> Mapping[str, Any]:
        """Return the number of programs that were started and that failed, and sentences on these."""
        counts = {"started": self._started, "failed": self._failed, "failures": list(self._failures)}
        return {"programs": counts}

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        for command in self._commands:
            if is_reaction(event, [command.thing], self._room):
                self._start(event.thing, command.filled(event))

    def _start(self, thing: str, arguments: Sequence[str]) -> None:
        about = f"{thing}: {shlex.join(arguments)}"
        if len(self._running) >= MAX_PROGRAMS:
            self._fail(f"{about} was not started, as {MAX_PROGRAMS} programs still run")
            return
        self._started += 1
        task = asyncio.create_task(self._run(about, arguments), name=about)
        self._running.add(task)
        task.add_done_callback(self._running.discard)

    async def _run(self, about: str, arguments: Sequence[str]) -> None:
        nothing = asyncio.subprocess.DEVNULL
        try:
            program = await asyncio.create_subprocess_exec(
                *arguments, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True
            )
        except OSError as error:
            self._fail(f"{about} could not be started ({error.strerror or error})")
            return
        try:
            async with asyncio.timeout(MAX_S):
                code = await program.wait()
        except TimeoutError:
            self._fail(f"{about} was ended after {MAX_S:g} s")
        else:
            if code:
                how = f"exit code {code}" if code > 0 else f"signal {-code}"
                self._fail(f"{about} ended with {how}")
        finally:
            await _end_group(program.pid)

    def _fail(self, sentence: str) -> None:
        log.warning("%s", sentence)
        self._failed += 1
        self._failures.append(sentence)

    def _end(self) -> None:
        for task in self._running:
            task.cancel()


async def _end_group(group: int) -> None:
    """End what is left of a process group, at once if this is cancelled."""
    try:
        os.killpg(group, signal.SIGTERM)
        await asyncio.sleep(GRACE_S)
    except OSError:  # nothing is left, or it belongs to another user
        return
    finally:
        with contextlib.suppress(OSError):
            os.killpg(group, signal.SIGKILL)


_option = click.option(
    "--on",
    multiple=True,
    metavar="THING=PROGRAM",
    help="start this program, without a shell, when somebody points at the thing of the map; its arguments "
    "may have {thing}, {user}, {confidence} and {state} (on or off). Repeatable",
)


def _add(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> Added:
    """Return the watcher that starts them; ConfigError: there is no such program, or no such thing."""
    commands = [Command.parse(text) for text in options["on"]]
    if not commands:
        return Added()
    room = room_of(site_launches(scenario, choices))
    for command in commands:
        if room is not None:
            command.check(room)
    return Added(watchers=[lambda _launches: Programs(commands)])


def _summary(summary: Mapping[str, Any]) -> list[str]:
    programs = summary.get("programs")
    if programs is None:
        return []
    failed = f", {programs['failed']} failed" if programs["failed"] else ""
    return [
        f"Programs: {programs['started']} started{failed}.",
        *(f"{each}." for each in programs["failures"]),
    ]


PROGRAMS_PART = RunPart(heading="Things", names=("on",), options=_option, add=_add)
PROGRAMS_DISPLAY = DisplayPart(
    rows=lambda _monitor, _width: None, lines=lambda _monitor: (), summary=_summary
)
