"""What selecting gives out: messages for people and everybody, records for the journal."""

from dataclasses import dataclass
from typing import Literal

from pointit.schemas import Feedback, Hover, Selection, SelectionEvent

Cause = Literal["", "dwell", "button", "undo", "clear", "release"]
"""What a person did that changed something."""

Action = Literal["", "select", "deselect", "refuse"]
"""What staying on an object would do."""

TOLD_AGAIN = "told again after a restart of the selector"
"""Reason of an event that readers may have seen: same object, event, stamp and number."""


@dataclass(frozen=True, slots=True)
class Output:
    """A message on its way."""

    user: str
    """Whose it is; empty: everybody's."""
    message: Hover | Selection | SelectionEvent | Feedback


@dataclass(frozen=True, slots=True)
class Owned:
    """Whose a selected object is, and since when."""

    user: str
    kind: str
    since_ns: int
    confidence: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """What happened to an object, for the audit; the ones of one object tell whether it is selected."""

    stamp_ns: int
    event: Literal["selected", "deselected", "refused", "left"]
    object_id: str
    kind: str = ""
    user: str = ""
    """Who did it; of `left`: whose it was."""
    owner: str = ""
    """Whose it is after `selected`, whose it was before anything else; empty: nobody's."""
    since_ns: int = 0
    """Since when it is, or was, theirs; 0: it is nobody's."""
    cause: Cause = ""
    method: str = ""
    confidence: float | None = None
    reason: str = ""
    seq: int | None = None
    """Of the `SelectionEvent` that told it; none: it was not told by us."""


def event_of(record: Record, seq: int, *, again: bool = False) -> SelectionEvent | None:
    """Return the message that tells of `record`; none of `left`, which its tracker tells.

    Args:
        record: what happened.
        seq: the message's number.
        again: it may have been told before a restart. Number, stamp, object and event are the same then.
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
        reason="; ".join(part for part in (record.reason, TOLD_AGAIN if again else "") if part),
        cause=record.cause,
        confidence=record.confidence,
    )
