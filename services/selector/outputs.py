"""Outputs of the selection engine: messages for people, and records for the journal."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

from pointit.schemas import Announced, Claim, Feedback, Hover, Selection, SelectionEvent
from pointit.schemas.base import Count, Fraction, Ns
from pointit.schemas.selection import REPEATED_REASON

Event = Literal["selected", "deselected", "refused", "left"]

Cause = Literal["", "dwell", "button", "undo", "clear", "release"]
"""Cause of a change: the person's action."""

ACTIONS = ("dwell", "button")
"""Causes by which a person selects or deselects the object that they point at."""

Action = Literal["", "select", "deselect", "refuse"]
"""Effect of staying on an object."""

CHANGES: tuple[Action, ...] = ("select", "deselect")
"""Effects that change an object."""


class Output(NamedTuple):
    """A message to publish."""

    user: str
    """User of the topic. `""` for a topic of the site."""
    message: Hover | Announced | Selection | SelectionEvent | Feedback | Claim


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


def event_of(record: Record, seq: int, *, again: bool = False) -> SelectionEvent | None:
    """Return the message of `record` with the number `seq`. None for `left`, which its tracker publishes.

    `again`: it may have been published before a restart, with equal number, stamp, object and event.
    """
    if record.event == "left":
        return None
    return SelectionEvent(
        stamp_ns=record.stamp_ns,
        seq=seq,
        event=record.event,
        object_id=record.object_id,
        kind=record.kind,
        user=record.owner if record.event == "selected" else record.user,
        reason="; ".join(part for part in (record.reason, REPEATED_REASON if again else "") if part),
        cause=record.cause,
        confidence=record.confidence,
    )
