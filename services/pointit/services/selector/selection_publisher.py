"""How it is told what is hovered, selected and done: numbered messages, and records for the journal."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable

from pointit.schemas import Cursor, Hover, ReservedObject, SelectedObject, Selection
from pointit.services.selector.cues import Kind, make_cue
from pointit.services.selector.methods.pointer import PointerResult
from pointit.services.selector.objects.view import View
from pointit.services.selector.outputs import Action, Output, Record, event_of


class SelectionPublisher:
    """Numbers messages by kind and person; decides nothing."""

    def __init__(self, record: Callable[[Record], None] | None, *, method: str, snap_rad: float) -> None:
        """Have told nothing yet.

        Args:
            record: is given what happened before the message that tells of it is returned.
            method: by which people select; records say so.
            snap_rad: so far beside an object the cursor is still shown on it.
        """
        self._record = record
        self.method = method
        self._snap_rad = snap_rad
        self._sent: Counter[tuple[str, str]] = Counter()
        """Messages by kind and person."""

    def resume_numbering(self, events: int) -> None:
        """Count events on from `events`, the last one's number before a restart."""
        self._sent["event", ""] = events

    def selection(
        self, now_ns: int, objects: tuple[SelectedObject, ...], reserved: tuple[ReservedObject, ...]
    ) -> Selection:
        """Return what tells everybody what is selected and reserved."""
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
        """Return what tells on what `user`'s cursor is.

        Args:
            user: who points.
            cursor: where to.
            view: what is near it, as seen from their eyes; none where that is not known.
            pointed: what was made of it.
            action: what staying on the object would do.
            taken_by: who else has it; empty: nobody.
            is_selected: whether anybody has it selected.
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
        """Record what happened, and return what tells everybody of it, if anything does."""
        seq = self._count("event")
        self.write(record, seq)
        message = event_of(record, seq)
        return [] if message is None else [Output("", message)]

    def write(self, record: Record, seq: int | None = None) -> None:
        """Record what happened; `seq`: number of the event that tells of it, none: it is not told."""
        if self._record is not None:
            self._record(dataclasses.replace(record, seq=seq, method=self.method))

    def cues(self, user: str, records: Iterable[Record], now_ns: int) -> list[Output]:
        """Return a cue for `user` for each thing that they did, or tried to do."""
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
