"""Messages of a site, as a witness outside of the network sees them."""

import collections
from dataclasses import dataclass, field
from typing import Any

from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import topics
from pointit.schemas.topics import Delivery
from tests.simulation.kernel.process import Process
from tests.simulation.kernel.timeline import Timeline

GONE_EVENTS = ("left", "dispatched")
"""Events of things that have left the room."""
SHOWN_CUES = ("selected", "deselected", "refused")

ActNumber = tuple[str, int]
"""Object and stamp of the event, ns."""


@dataclass
class ToldEvent:
    """A selection event as the selector told it, with its outcomes and their times, s."""

    event: Any
    at_s: float
    process: Process
    outcomes: list[tuple[float, Any]] = field(default_factory=list[tuple[float, Any]])

    @property
    def has_succeeded(self) -> bool:
        """Return True if an outcome says that it is done or has started."""
        return any(outcome.result != "failed" for _, outcome in self.outcomes)


class History:
    """The newest and the past of what was told. It also writes the trace."""

    def __init__(self, timeline: Timeline) -> None:
        self.events: dict[ActNumber, ToldEvent] = {}
        """Selected and deselected events, in order."""
        self.newest: dict[tuple[str, str], tuple[Process, Any, float]] = {}
        """Writer, newest message and its time, s, by topic key and name: of states, hovers and frames."""
        self.selection: Any = None
        """Newest selection, or None."""
        self.carriers: dict[str, tuple[Process, float]] = {}
        """Process of each carrier, and the time of its first report, s."""
        self.messages = collections.Counter[str]()
        """Number of messages by topic key."""
        self._timeline = timeline
        self._shown: dict[tuple[str, str], str] = {}

    def on_put(self, process: Process, topic: AnyTopic, name: str, message: Any) -> None:
        """Take a message."""
        self.messages[topic.key] += 1
        if topic.delivery is Delivery.STATE or topic is topics.HOVER or topic is topics.STRIPS_FRAME:
            self.newest[topic.key, name] = (process, message, self._timeline.now_s)
        if topic is topics.SELECTION:
            self.selection = message
        elif topic is topics.SELECTION_EVENTS:
            self._on_event(process, message)
        elif topic is topics.OUTCOMES:
            self._on_outcome(message)
        elif topic is topics.THING_STATES:
            self._on_carrier(process, name, message)
        elif topic is topics.HOVER:
            self._show("hover", name, message.object_id or "nothing", process)
        elif topic is topics.CURSOR:
            self._show("cursor", name, "nothing" if message.point_m is None else "somewhere", process)
        else:
            self._note_other(topic, name, message)

    def _on_event(self, process: Process, event: Any) -> None:
        if event.event in GONE_EVENTS:
            return
        text = f"{event.seq} {event.event} {event.object_id} {event.user} {event.cause}"
        text += f" {' '.join(event.carriers)} {_short(event.stamp_ns)} {event.reason[:80]}"
        self._timeline.note("event", text)
        if event.event != "refused":
            told = ToldEvent(event, self._timeline.now_s, process)
            self.events.setdefault((event.object_id, event.stamp_ns), told)

    def _on_outcome(self, outcome: Any) -> None:
        text = f"{outcome.object_id} {_short(outcome.event_ns)} {outcome.result} {outcome.code}"
        self._timeline.note("outcome", f"{text} {outcome.text[:80]}")
        told = self.events.get((outcome.object_id, outcome.event_ns))
        if told is not None:
            told.outcomes.append((self._timeline.now_s, outcome))

    def _on_carrier(self, process: Process, name: str, message: Any) -> None:
        known = self.carriers.get(name)
        if known is None or known[0] is not process:
            self.carriers[name] = (process, self._timeline.now_s)
        things = " ".join(f"{each.id}={each.state or '-'}" for each in message.things)
        self._timeline.note("states", f"{name} {things}")

    def _show(self, kind: str, name: str, text: str, process: Process) -> None:
        if self._shown.get((kind, name)) != text:
            self._shown[kind, name] = text
            self._timeline.note(kind, f"{name} {text} ({process.name})")

    def _note_other(self, topic: AnyTopic, name: str, message: Any) -> None:
        note = self._timeline.note
        if topic is topics.ACT_RESULTS:
            text = f"{name} {message.object_id} {_short(message.event_ns)} {message.result}"
            note("result", f"{text} {message.code} {message.text[:60]}")
        elif topic is topics.FEEDBACK and message.cue in SHOWN_CUES:
            note("cue", f"{name} {message.cue}: {message.text[:100]}")
        elif topic is topics.CLAIM and message.wish == "toggle":
            note("claim", f"{name} {message.object_id} {message.action} {_short(message.stamp_ns)}")
        elif topic is topics.LAMP_COLOR:
            note("lamp", f"{name} {message.color}")
        elif topic is topics.INTERACTION:
            note("stage", f"{name} {message.state}")

    def owner(self, thing: str) -> str:
        """Return the owner of `thing` by the newest selection, or `""`."""
        if self.selection is not None:
            for each in self.selection.objects:
                if each.id == thing:
                    return str(each.user)
        return ""

    def newest_event(self, thing: str) -> ToldEvent | None:
        """Return the newest selected or deselected event of `thing`."""
        for told in reversed(self.events.values()):
            if told.event.object_id == thing:
                return told
        return None

    def selected_things(self) -> set[str]:
        """Return all that is selected by the newest selection."""
        return set() if self.selection is None else {each.id for each in self.selection.objects}


def _short(stamp_ns: int) -> int:
    """Return the digits of a stamp that differ within a run."""
    return stamp_ns % 10**12
