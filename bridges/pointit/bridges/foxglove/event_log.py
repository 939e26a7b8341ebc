"""Log lines from messages: warnings of services, events, cues, localizations, presence."""

import re
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from foxglove.messages import Log, LogLevel

from pointit.bridges.foxglove import shapes
from pointit.schemas import Feedback, Health, Interaction, Localization, Message, RobotState, SelectionEvent

HISTORY = 200
"""Lines kept for viewers that join late."""

_NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(frozen=True, slots=True)
class LogLine:
    """One log line with its time and source."""

    at_ns: int
    level: LogLevel
    source: str
    text: str

    def log(self) -> Log:
        """Return it as a Foxglove message."""
        at = shapes.timestamp(self.at_ns)
        return Log(timestamp=at, level=self.level, message=self.text, name=self.source)


@dataclass(slots=True)
class _Account:
    warnings: dict[str, str]
    """By text without numbers, which may change every second."""
    errors: int
    lost: int
    invalid: int


class EventLog:
    """Turns messages into log lines. Each change is reported once."""

    def __init__(self) -> None:
        self.history: deque[LogLine] = deque(maxlen=HISTORY)
        self._health_counts: dict[str, _Account] = {}
        self._phases: dict[str, tuple[str, str]] = {}
        self._states: dict[str, str] = {}
        self._robots: dict[str, tuple[str, str]] = {}
        """Owner of each robot, and its reason without numbers."""
        self._writers: dict[type[Message], Callable[[Any, str], Iterator[tuple[LogLevel, str]]]] = {
            Health: self._health,
            SelectionEvent: self._selection,
            Feedback: self._feedback,
            Localization: self._localization,
            Interaction: self._interaction,
            RobotState: self._robot,
        }

    def take(self, message: Message, name: str, now_ns: int) -> list[LogLine]:
        """Return the new lines from `message`, whose key has `name`."""
        writer = self._writers.get(type(message))
        return [] if writer is None else self._lines_of(writer(message, name), name or "selection", now_ns)

    def presence(self, instance: str, now_ns: int, *, present: bool) -> list[LogLine]:
        """Return the line that says that a service has started or ended."""
        if not present:
            self._health_counts.pop(instance, None)
        sentences = (LogLevel.Info, "runs") if present else (LogLevel.Warning, "has ended")
        return self._lines_of(iter([sentences]), instance, now_ns)

    def leave(self, user: str) -> None:
        """Forget the states of a person who has left."""
        self._phases.pop(user, None)
        self._states.pop(user, None)

    def active_warnings(self, now_ns: int) -> list[LogLine]:
        """Return the warnings that are active now."""
        return [
            LogLine(now_ns, LogLevel.Warning, instance, sentence)
            for instance, account in self._health_counts.items()
            for sentence in account.warnings.values()
        ]

    def _lines_of(self, sentences: Iterator[tuple[LogLevel, str]], source: str, now_ns: int) -> list[LogLine]:
        lines = [LogLine(now_ns, level, source, text) for level, text in sentences]
        self.history += lines
        return lines

    def _health(self, health: Health, instance: str) -> Iterator[tuple[LogLevel, str]]:
        now = _Account(
            {_NUMBER.sub("#", sentence): sentence for sentence in health.warnings},
            health.errors,
            sum(key.lost for key in health.keys),
            sum(key.invalid for key in health.keys),
        )
        before = self._health_counts.get(instance, _Account({}, 0, 0, 0))
        self._health_counts[instance] = now
        for kind, sentence in now.warnings.items():
            if kind not in before.warnings:
                yield LogLevel.Warning, sentence
        for kind, sentence in before.warnings.items():
            if kind not in now.warnings:
                yield LogLevel.Info, f"no longer: {sentence}"
        if now.errors > before.errors:
            yield LogLevel.Error, f"{now.errors - before.errors} handlers failed; see its log"
        if now.lost > before.lost:
            yield LogLevel.Warning, f"{now.lost - before.lost} events were lost on their way to it"
        if now.invalid > before.invalid:
            yield LogLevel.Warning, f"{now.invalid - before.invalid} messages to it could not be read"

    def _selection(self, event: SelectionEvent, _name: str) -> Iterator[tuple[LogLevel, str]]:
        words = [event.user, event.event, event.kind, event.object_id]
        words += [f"to bay {event.bay}"] if event.bay else []
        text = " ".join(word for word in words if word)
        level = LogLevel.Warning if event.event == "refused" else LogLevel.Info
        yield level, f"{text}: {event.reason}" if event.reason else text

    def _feedback(self, cue: Feedback, _user: str) -> Iterator[tuple[LogLevel, str]]:
        yield LogLevel.Info, f"cue {cue.cue}: {cue.text}" if cue.text else f"cue {cue.cue}"

    def _localization(self, message: Localization, user: str) -> Iterator[tuple[LogLevel, str]]:
        phase = (message.phase, message.target_id)
        before = self._phases.get(user)
        self._phases[user] = phase
        if phase == before or (before is None and message.phase == "idle"):
            return
        level = LogLevel.Warning if message.phase == "refused" else LogLevel.Info
        target = f" {message.target_id}" if message.target_id else ""
        yield (
            level,
            f"localization {message.phase}{target}" + (f": {message.reason}" if message.reason else ""),
        )

    def _interaction(self, message: Interaction, user: str) -> Iterator[tuple[LogLevel, str]]:
        if self._states.get(user) == message.state:
            return
        self._states[user] = message.state
        yield LogLevel.Info, f"is {message.state}" + (f": {message.reason}" if message.reason else "")

    def _robot(self, message: RobotState, name: str) -> Iterator[tuple[LogLevel, str]]:
        now = (message.user, _NUMBER.sub("#", message.reason))
        user, reason = self._robots.get(name, ("", ""))
        self._robots[name] = now
        if message.user != user:
            yield LogLevel.Info, f"{message.user or 'nobody'} steers it"
        if now[1] and now[1] != reason:
            yield LogLevel.Warning, f"{message.phase.replace('_', ' ')}: {message.reason}"
