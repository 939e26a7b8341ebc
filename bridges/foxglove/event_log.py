"""Log lines of what happens at a site."""

from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from foxglove.messages import Log, LogLevel

from pointit.bridges.foxglove import shapes
from pointit.plugins import Change, SiteState
from pointit.schemas import (
    Feedback,
    Health,
    Interaction,
    Localization,
    Message,
    RobotState,
    SelectionEvent,
    topics,
)

HISTORY = 200
"""Lines kept for viewers that join late."""
MAX_STATES = 1000
"""Maximum number of states that are remembered; the oldest go first."""

Sentences = Iterator[tuple[LogLevel, str]]
"""Levels and texts of log lines."""
SentenceWriter = Callable[[Any, Any], Sentences]
"""Describes a message and the previous one of its key."""


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


class EventLog:
    """Turns changes of a site into log lines."""

    def __init__(self, site: SiteState) -> None:
        self.history: deque[LogLine] = deque(maxlen=HISTORY)
        self._site = site
        self._states: OrderedDict[tuple[type[Message], str], Message] = OrderedDict()
        """Last states by type and name. They outlive their services, with which they return unchanged."""
        self._writers: dict[type[Message], SentenceWriter] = {
            Health: self._health,
            SelectionEvent: self._selection,
            Feedback: self._feedback,
            Localization: self._localization,
            Interaction: self._interaction,
            RobotState: self._robot,
        }

    def take(self, change: Change, now_ns: int) -> list[LogLine]:
        """Return the new lines from a change."""
        message = change.message
        if message is None:
            return []
        writer = self._writers.get(type(message))
        if writer is None:
            return []
        previous = change.previous
        if isinstance(message, Localization | Interaction | RobotState):
            key = type(message), change.name
            previous = self._states.pop(key, None)
            self._states[key] = message
            if len(self._states) > MAX_STATES:
                self._states.popitem(last=False)
        source = change.name or "selection"
        return self._lines_of(writer(message, previous), source, now_ns)

    def presence(self, instance: str, now_ns: int, *, present: bool) -> list[LogLine]:
        """Return the line about a service that has started or ended."""
        sentence = (LogLevel.Info, "runs") if present else (LogLevel.Warning, "has ended")
        return self._lines_of(iter([sentence]), instance, now_ns)

    def active_warnings(self, now_ns: int) -> list[LogLine]:
        """Return the warnings that are active now."""
        lines: list[LogLine] = []
        for instance, health in self._site.all(topics.HEALTH).items():
            for sentence in _warnings(health).values():
                lines.append(LogLine(now_ns, LogLevel.Warning, instance, sentence))
        return lines

    def _lines_of(self, sentences: Sentences, source: str, now_ns: int) -> list[LogLine]:
        lines = [LogLine(now_ns, level, source, text) for level, text in sentences]
        self.history += lines
        return lines

    def _health(self, health: Health, previous: Health | None) -> Sentences:
        current_warnings = _warnings(health)
        previous_warnings = _warnings(previous)
        for identity, sentence in current_warnings.items():
            if identity not in previous_warnings:
                yield LogLevel.Warning, sentence
        for identity, sentence in previous_warnings.items():
            if identity not in current_warnings:
                yield LogLevel.Info, f"no longer: {sentence}"

        # Counts of a service that has been started again may be lower
        for level, text, name in (
            (LogLevel.Error, "handlers failed; see its log", "errors"),
            (LogLevel.Warning, "events were lost on their way to it", "lost"),
            (LogLevel.Warning, "messages to it could not be read", "invalid"),
        ):
            increase = _count(health, name) - _count(previous, name)
            if increase > 0:
                yield level, f"{increase} {text}"

    def _selection(self, event: SelectionEvent, _previous: None) -> Sentences:
        action = "started" if event.status == "pending" else event.event
        words = [event.user, action, event.kind, event.object_id]
        if event.bay:
            words.append(f"to bay {event.bay}")
        level = LogLevel.Warning if event.event == "refused" else LogLevel.Info
        text = " ".join(filter(None, words))
        yield level, _with_reason(text, event.reason)

    def _feedback(self, cue: Feedback, _previous: None) -> Sentences:
        text = f"cue {cue.cue}"
        yield LogLevel.Info, _with_reason(text, cue.text)

    def _localization(self, message: Localization, previous: Localization | None) -> Sentences:
        phase = (message.phase, message.target_id)
        if previous is None:
            is_same = message.phase == "idle"
        else:
            is_same = phase == (previous.phase, previous.target_id)
        if is_same:
            return
        level = LogLevel.Warning if message.phase == "refused" else LogLevel.Info
        target = f" {message.target_id}" if message.target_id else ""
        text = f"localization {message.phase}{target}"
        yield level, _with_reason(text, message.reason)

    def _interaction(self, message: Interaction, previous: Interaction | None) -> Sentences:
        if previous is None or previous.state != message.state:
            text = f"is {message.state}"
            yield LogLevel.Info, _with_reason(text, message.reason)

    def _robot(self, message: RobotState, previous: RobotState | None) -> Sentences:
        previous_user = previous.user if previous else ""
        if message.user != previous_user:
            yield LogLevel.Info, f"{message.user or 'nobody'} steers it"
        if message.has_new_reason(previous):
            phase = message.phase.replace("_", " ")
            yield LogLevel.Warning, f"{phase}: {message.reason}"


def _with_reason(text: str, reason: str) -> str:
    return f"{text}: {reason}" if reason else text


def _warnings(health: Health | None) -> dict[tuple[str, ...], str]:
    """Return the sentences of the warnings in a report by the identity of the problem."""
    problems = () if health is None else health.all_problems
    warnings = (problem for problem in problems if problem.severity == "warning")
    return {warning.identity: warning.sentence for warning in warnings}


def _count(health: Health | None, name: str) -> int:
    """Return the errors of a report, or what its keys have counted."""
    if health is None:
        return 0
    if name == "errors":
        return health.errors
    return sum(getattr(key, name) for key in health.keys)
