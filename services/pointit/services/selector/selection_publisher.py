"""Numbered messages for hovers, selections and events, and records for the journal."""

from collections import Counter
from collections.abc import Callable, Iterable

from pointit.schemas import Cursor, Hover, ReservedObject, SelectedObject, Selection
from pointit.services.selector.cues import Kind, make_cue
from pointit.services.selector.methods.pointer import PointerResult
from pointit.services.selector.objects.view import View
from pointit.services.selector.outputs import Action, Output, Record, event_of


class SelectionPublisher:
    """Numbers messages by kind and person. Decides nothing."""

    def __init__(self, record: Callable[[Record], None], *, method: str, snap_rad: float) -> None:
        """Create with no message sent.

        Args:
            record: called with each event before its message is returned.
            method: method of selecting, for the records.
            snap_rad: angle beside an object within which the cursor is still shown on it.
        """
        self._record = record
        self.method = method
        self._snap_rad = snap_rad
        self._sent: Counter[tuple[str, str]] = Counter()
        """Number of messages by kind and person."""

    def resume_numbering(self, events: int) -> None:
        """Continue numbering events after `events`, the last number before a restart."""
        self._sent["event", ""] = events

    def selection(
        self, now_ns: int, objects: tuple[SelectedObject, ...], reserved: tuple[ReservedObject, ...]
    ) -> Selection:
        """Return the message of what is selected and reserved."""
        return Selection(stamp_ns=now_ns, seq=self._count("selection"), objects=objects, reserved=reserved)

    def hover(
        self,
        user: str,
        cursor: Cursor,
        view: View | None,
        pointed: PointerResult,
        *,
        action: Action,
        taken_by: str,
        is_selected: bool,
    ) -> Output:
        """Return the hover message for `user`'s cursor.

        Args:
            user: person who points.
            cursor: their cursor.
            view: objects near it, as seen from their eyes, or None if unknown.
            pointed: result of the method.
            action: effect of staying on the object.
            taken_by: other person who has it, or `""`.
            is_selected: True if it is selected by any person.
        """
        seq = self._count("hover", user)
        object_id = pointed.object_id
        if object_id is None:
            return Output(user, Hover(stamp_ns=cursor.stamp_ns, seq=seq))
        snapped = None if view is None else view.snapped(object_id, cursor, self._snap_rad)
        hover = Hover(
            stamp_ns=cursor.stamp_ns,
            seq=seq,
            object_id=object_id,
            progress=pointed.progress,
            action=action,
            taken_by=taken_by,
            is_selected=is_selected,
            snapped_m=None if snapped is None else snapped[0],
            snapped_position_m=None if snapped is None else snapped[1],
            miss_rad=None if view is None else view.miss_rad(object_id, cursor),
        )
        return Output(user, hover)

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
        outputs: list[Output] = []
        for record in records:
            if record.event != "left":
                text = record.reason or f"{record.kind or 'object'} {record.event}"
                outputs.append(self.cue(user, record.event, text, now_ns))
        return outputs

    def cue(self, user: str, kind: Kind, text: str, now_ns: int) -> Output:
        """Return the cue `kind` for `user`."""
        return Output(user, make_cue(kind, text, now_ns, self._count("cue", user)))

    def _count(self, kind: str, user: str = "") -> int:
        self._sent[kind, user] += 1
        return self._sent[kind, user]
