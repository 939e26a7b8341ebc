"""Numbered messages for selections, events and cues, and records for the journal."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Literal

from pointit.schemas import Feedback, ReservedObject, SelectedObject, Selection
from pointit.schemas.selection import SIGNS
from pointit.services.selector.outputs import Output, Record, event_of

Kind = Literal["selected", "deselected", "refused"]


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
        dwell_s: float | None,
    ) -> Selection:
        """Return the message of what is selected and reserved. `dwell_s`: told with the method, or None."""
        selection = Selection(
            stamp_ns=now_ns, seq=self._count("selection"), objects=objects, reserved=reserved
        )
        if dwell_s is None:
            return selection
        return selection.model_copy(update={"method": self.method, "dwell_s": dwell_s})

    def event(self, record: Record) -> list[Output]:
        """Record an event. Return its message, if it has one."""
        seq = self._count("event")
        self.write(record, seq)
        message = event_of(record, seq)
        return [] if message is None else [Output("", message)]

    def write(self, record: Record, seq: int | None = None) -> None:
        """Record an event. `seq`: number of its message, or None if it has none."""
        self._record(record._replace(seq=seq, method=self.method))

    def cues(self, user: str, records: Iterable[Record], now_ns: int) -> list[Output]:
        """Return a cue for `user` for each thing that they did or tried to do."""
        return [
            self.cue(user, record.event, record.reason or f"{record.kind or 'object'} {record.event}", now_ns)
            for record in records
            if record.event != "left"
        ]

    def cue(self, user: str, kind: Kind, text: str, now_ns: int) -> Output:
        """Return the cue `kind` for `user`."""
        return Output(user, make_cue(kind, text, now_ns, self._count("cue", user)))

    def _count(self, kind: str, user: str = "") -> int:
        self._sent[kind, user] += 1
        return self._sent[kind, user]


def make_cue(kind: Kind, text: str, stamp_ns: int, seq: int) -> Feedback:
    """Return the multimodal cue of `kind`, as defined in `SIGNS`."""
    return Feedback(stamp_ns=stamp_ns, seq=seq, cue=kind, text=text, **SIGNS[kind]._asdict())
