"""Reactions of `pointit run --on`: programs and webhooks, when people point at things."""

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Coroutine, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, cast

from pointit.api.reactions import check_things, is_reaction
from pointit.cli.things.program import Program
from pointit.cli.things.webhook import Webhook
from pointit.launch.plan.plan import OnEvent
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.schemas import Environment, SelectionEvent
from pointit.schemas.text import hide_secrets
from pointit.schemas.topics import SELECTION_EVENTS

log = logging.getLogger(__name__)

MAX_AT_ONCE = 8
"""Maximum number of reactions at a time. Further ones are dropped."""
MAX_FAILURES = 20
"""Number of last failures in the summary. Earlier ones are only counted."""
FILES = (".yaml", ".yml")


class ReactionTarget(Protocol):
    """Program or webhook."""

    interruption: ClassVar[str]
    """Problem if the end of the run interrupts it, or `""`."""

    def describe(self, values: Mapping[str, str], /) -> str:
        """Return a description for logs."""
        ...

    def react(self, values: Mapping[str, str], /) -> Coroutine[Any, Any, str]:
        """Do it. Return what went wrong, or `""`. `values`: those of placeholders, and `stamp_ns`."""
        ...


@dataclass(frozen=True, kw_only=True)
class Reaction:
    """Thing, and the program or webhook for when somebody points at it."""

    thing: str
    target: ReactionTarget

    @classmethod
    def parse(cls, text: str, room: Environment | None = None) -> Self:
        """Return the reaction in `THING=PROGRAM ARGUMENTS...` or `THING=URL`. `room`: the map, if known.

        Raises:
            ConfigError: If it is invalid, the map lacks the thing, or the program or URL cannot be used.
        """
        thing, _, line = (part.strip() for part in text.partition("="))
        if not thing or not line:
            raise ConfigError(
                f"{text!r}: write THING=PROGRAM, such as 'screws=./order.sh {{user}}', THING=URL or FILE.yaml"
            )
        is_url = line.startswith(("http://", "https://"))
        try:
            if room is not None:
                check_things([thing], room)
            return cls(thing=thing, target=Webhook.parse(line) if is_url else Program.parse(line))
        except ConfigError as error:
            raise ConfigError(f"{thing}: {error}") from error

    def check(self, room: Environment) -> None:
        """Check that the map has the thing. Raises ConfigError."""
        try:
            check_things([self.thing], room)
        except ConfigError as error:
            raise ConfigError(f"{self.thing}: {error}") from error


def reactions_in(text: str, room: Environment | None = None) -> Iterator[Reaction]:
    """Yield the reactions of a value of `--on`: one, or those of a file `THING: [PROGRAM or URL, ...]`.

    `room`: the map, if known.

    Raises:
        ConfigError: If one cannot be used, or the file is none.
    """
    if "=" in text or not text.endswith(FILES):
        yield Reaction.parse(text, room)
        return
    for thing, lines in read_yaml(Path(text)).items():
        for line in cast("list[object]", lines) if isinstance(lines, list) else [lines]:
            if not isinstance(line, str):
                raise ConfigError(
                    f"{text}: {thing}: write a program or a URL, or a list of them, not {line!r}"
                )
            try:
                yield Reaction.parse(f"{thing}={line}", room)
            except ConfigError as error:
                raise ConfigError(f"{text}: {error}") from error


class Reactions:
    """Watcher of a run that reacts, and ends all with the scenario."""

    def __init__(self, reactions: Sequence[Reaction]) -> None:
        """Do those of `reactions` whose thing is pointed at."""
        self._reactions = reactions
        self._room: Environment | None = None
        self._running: dict[asyncio.Task[str], tuple[str, ReactionTarget]] = {}
        """Reactions without a result, with their description."""
        self._done = 0
        self._failed = 0
        self._dropped = 0
        self._failures: deque[str] = deque(maxlen=MAX_FAILURES)

    def attach(self, bus: Bus, on_event: OnEvent) -> Sequence[Closable]:
        """Subscribe on `bus`. Return the subscription, and a function that ends all reactions."""
        del on_event
        ending = contextlib.ExitStack()
        ending.callback(self._end)
        return ending, bus.subscribe(SELECTION_EVENTS, self._on_event)

    def on_map(self, environment: Environment) -> None:
        """Update the things, and report those that it lacks."""
        self._room = environment
        for reaction in self._reactions:
            try:
                reaction.check(environment)
            except ConfigError as error:
                self._report(str(error))

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Ignore services."""

    def summary(self) -> Mapping[str, Any]:
        """Return the number of reactions by result, and sentences on failures.

        Those that were started are done, have failed, or still run; at the end of the run, none does.
        """
        counts = {"done": self._done, "failed": self._failed, "dropped": self._dropped}
        started = self._done + self._failed + len(self._running)
        return {"reactions": {"started": started, **counts, "failures": list(self._failures)}}

    def _on_event(self, event: SelectionEvent, _name: str) -> None:
        for reaction in self._reactions:
            if is_reaction(event, [reaction.thing], self._room):
                self._start(event, reaction.target)

    def _start(self, event: SelectionEvent, target: ReactionTarget) -> None:
        values = {
            "thing": event.thing,
            "user": event.user,
            "confidence": "" if event.confidence is None else f"{event.confidence:.2f}",
            "state": "on" if event.is_on else "off",
            "stamp_ns": str(event.stamp_ns),
        }
        description = f"{event.thing}: {target.describe(values)}"
        if len(self._running) >= MAX_AT_ONCE:
            self._dropped += 1
            self._report(f"{description} was not started, as {MAX_AT_ONCE} reactions still run")
            return
        task = asyncio.create_task(target.react(values), name=description)
        self._running[task] = description, target
        task.add_done_callback(self._settle)

    def _settle(self, task: asyncio.Task[str]) -> None:
        """Count the result of `task`, unless the end of the run has counted it."""
        error = None if task.cancelled() else task.exception()
        if task not in self._running:
            return
        description, target = self._running.pop(task)
        if error is not None:
            problem = f"stopped by an unexpected error ({type(error).__name__}: {error})"
        else:
            problem = target.interruption if task.cancelled() else task.result()
        self._count(description, problem)

    def _count(self, description: str, problem: str) -> None:
        if problem:
            self._failed += 1
            self._report(f"{description} {problem}")
        else:
            self._done += 1

    def _report(self, sentence: str) -> None:
        log.warning("%s", sentence)
        self._failures.append(hide_secrets(sentence))

    def _end(self) -> None:
        for task in list(self._running):
            if task.done():
                self._settle(task)
            else:
                task.cancel()
                description, target = self._running.pop(task)
                self._count(description, target.interruption)
