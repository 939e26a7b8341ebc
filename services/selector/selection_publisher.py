"""Outputs of the selection: numbered messages of selections, events and cues, and records for the journal."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from pointit.schemas import (
    ActOutcome,
    ActState,
    Announced,
    Claim,
    Feedback,
    Hover,
    ReservedObject,
    SelectedObject,
    Selection,
    SelectionEvent,
)
from pointit.schemas.base import Count, Fraction, Ns
from pointit.schemas.cues import SIGNS
from pointit.schemas.selection import BEGIN_WITHIN_S, REPEATED_REASON, ActStatus

Event = Literal["selected", "deselected", "refused", "left"]

Cause = Literal["", "dwell", "button", "undo", "clear", "release"]
"""Cause of a change: the person's action."""
Action = Literal["", "select", "deselect", "refuse"]
"""Effect of staying on an object."""
Kind = Literal["selected", "deselected", "refused"]

ACTIONS = ("dwell", "button")
"""Causes by which a person selects or deselects the object that they point at."""
CHANGES: tuple[Action, ...] = ("select", "deselect")
"""Effects that change an object."""


class OutgoingMessage(NamedTuple):
    """A message to publish."""

    user: str
    """User of the topic. `""` for a topic of the site."""
    message: Hover | Announced | Selection | SelectionEvent | Feedback | Claim | ActOutcome


@dataclass(frozen=True, slots=True)
class Owned:
    """Owner of a selected object, and the time of selection."""

    user: str
    kind: str
    since_ns: int
    confidence: float | None = None


class Record(NamedTuple):
    """An event of an object, for the audit. The events of one object determine if it is selected."""

    stamp_ns: Ns
    event: Event
    object_id: str
    kind: str = ""
    user: str = ""
    """Person who caused it. For `left`: the owner."""
    owner: str = ""
    """Owner after `selected`, owner before any other event. `""` if there is none."""
    since_ns: Ns = 0
    """Time since which `owner` has or had it, ns. 0 if there is no owner."""
    cause: Cause = ""
    method: str = ""
    confidence: Fraction | None = None
    reason: str = ""
    seq: Count | None = None
    """Number of its `SelectionEvent`. None if it was not published by us."""
    carriers: str = ""
    """Names of those who carry it out, with spaces between, until they have reported the result."""

    @property
    def effect(self) -> Literal["", "select", "deselect"]:
        """Return what it is to do. `""` if it was refused, or its object left."""
        effects: dict[str, Literal["select", "deselect"]] = {"selected": "select", "deselected": "deselect"}
        return effects.get(self.event, "")

    @property
    def status(self) -> ActStatus | None:
        """Return the state of its act before a carrier reports, or None if it is no act."""
        if self.event == "left":
            return None
        if self.event == "refused":
            return "failed"
        return "asked" if self.carriers else "done"


def event_of(record: Record, seq: int, *, again: bool = False) -> SelectionEvent | None:
    """Return the message of `record` with the number `seq`. None for `left`, which its tracker publishes.

    `again`: it may have been published before a restart, with equal number, stamp, object and event.
    """
    if record.event == "left":
        return None
    reason = record.reason
    if again:
        reason = f"{reason}; {REPEATED_REASON}" if reason else REPEATED_REASON
    return SelectionEvent(
        stamp_ns=record.stamp_ns,
        seq=seq,
        event=record.event,
        object_id=record.object_id,
        kind=record.kind,
        user=record.owner if record.event == "selected" else record.user,
        reason=reason,
        cause=record.cause,
        confidence=record.confidence,
        carriers=tuple(record.carriers.split()),
        status=record.status,
    )


class SelectionPublisher:
    """Numbers messages by kind and person. Decides nothing."""

    def __init__(self, record: Callable[[Record], None], *, method: str) -> None:
        """Create with no message sent.

        Args:
            record: called with each event before its message is returned.
            method: method of selecting, for the records.
        """
        self._record = record
        self.method = method
        self._sent: Counter[tuple[str, str]] = Counter()
        """Number of messages by kind and person."""

    def resume_numbering(self, events: int) -> None:
        """Continue numbering events after `events`, the last number before a restart."""
        self._sent["event", ""] = events

    def selection(
        self,
        now_ns: int,
        objects: tuple[SelectedObject, ...],
        reserved: tuple[ReservedObject, ...],
        acts: tuple[ActState, ...],
        dwell_s: float | None,
    ) -> Selection:
        """Return the message of what is selected and reserved. `dwell_s`: sent with the method, or None."""
        selection = Selection(
            stamp_ns=now_ns, seq=self._count("selection"), objects=objects, reserved=reserved, acts=acts
        )
        if dwell_s is None:
            return selection
        return selection.model_copy(update={"method": self.method, "dwell_s": dwell_s})

    def event(self, record: Record, others: str = "") -> list[OutgoingMessage]:
        """Record an event. Return its message, if it has one.

        `others`: carriers that carry it out, too, but whose result nobody waits for.
        """
        seq = self._count("event")
        self.write(record, seq)
        message = event_of(record, seq)
        if message is None:
            return []
        if others:  # no result of theirs follows, so its status is that of an event without carriers
            message = message.model_copy(update={"carriers": (*message.carriers, *others.split())})
        if record.carriers:
            message = message.model_copy(update={"begin_within_s": BEGIN_WITHIN_S})
        return [OutgoingMessage("", message)]

    def outcome(self, outcome: ActOutcome) -> OutgoingMessage:
        """Return the message of the result of an act."""
        seq = self._count("outcome")
        return OutgoingMessage("", outcome.model_copy(update={"seq": seq}))

    def write(self, record: Record, seq: int | None = None) -> None:
        """Record an event. `seq`: number of its message, or None if it has none."""
        self._record(record._replace(seq=seq, method=self.method))

    def cues(self, user: str, records: Iterable[Record], now_ns: int) -> list[OutgoingMessage]:
        """Return a cue for `user` for each thing that they did or tried to do."""
        outputs: list[OutgoingMessage] = []
        for record in records:
            if record.event == "left":
                continue
            kind = record.kind or "object"
            text = record.reason or f"{kind} {record.event}"
            outputs.append(self.cue(user, record.event, text, now_ns))
        return outputs

    def cue(self, user: str, kind: Kind, text: str, now_ns: int) -> OutgoingMessage:
        """Return the cue `kind` for `user`."""
        seq = self._count("cue", user)
        return OutgoingMessage(user, make_cue(kind, text, now_ns, seq))

    def _count(self, kind: str, user: str = "") -> int:
        self._sent[kind, user] += 1
        return self._sent[kind, user]


def make_cue(kind: Kind, text: str, stamp_ns: int, seq: int) -> Feedback:
    """Return the multimodal cue of `kind`, as defined in `SIGNS`."""
    return Feedback(stamp_ns=stamp_ns, seq=seq, cue=kind, text=text, **SIGNS[kind]._asdict())
