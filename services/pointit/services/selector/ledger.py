"""Who has selected what: toggles and departures in, events and the selection out."""

from collections.abc import Container
from dataclasses import dataclass
from typing import Literal

from pointit.schemas import SelectedObject, Selection, SelectionEvent

_Event = Literal["selected", "deselected", "refused"]


@dataclass(frozen=True, slots=True)
class _Entry:
    user: str
    kind: str
    since_ns: int


class Ledger:
    """Keeps what is selected; an object has one owner, and only its owner deselects it.

    What belongs to a person who is gone may be deselected by anybody.
    """

    def __init__(self) -> None:
        self._entries: dict[str, _Entry] = {}
        self._gone: set[str] = set()
        self._events = 0
        self._selections = 0

    def set_gone(self, user: str, *, gone: bool) -> None:
        """Take note that `user` is gone, or there again."""
        if gone and any(entry.user == user for entry in self._entries.values()):
            self._gone.add(user)
        elif not gone:
            self._gone.discard(user)

    def toggle(self, object_id: str, kind: str, user: str, stamp_ns: int) -> SelectionEvent:
        """Select or deselect `object_id` for `user`; refused when it is somebody else's who is there."""
        entry = self._entries.get(object_id)
        if entry is None:
            self._entries[object_id] = _Entry(user, kind, stamp_ns)
            return self._event("selected", object_id, kind, user, stamp_ns)
        if entry.user != user and entry.user not in self._gone:
            reason = (
                f"{entry.kind or 'object'} is selected by {entry.user}; only {entry.user} can deselect it"
            )
            return self._event("refused", object_id, entry.kind, user, stamp_ns, reason=reason)
        del self._entries[object_id]
        return self._event("deselected", object_id, entry.kind, user, stamp_ns)

    def clear(self, user: str, stamp_ns: int) -> list[SelectionEvent]:
        """Deselect everything that is `user`'s."""
        own = [(object_id, entry) for object_id, entry in self._entries.items() if entry.user == user]
        for object_id, _ in own:
            del self._entries[object_id]
        return [self._event("deselected", object_id, e.kind, user, stamp_ns) for object_id, e in own]

    def keep(self, present: Container[str]) -> bool:
        """Forget what is not in `present`; return whether anything was."""
        gone = [object_id for object_id in self._entries if object_id not in present]
        for object_id in gone:
            del self._entries[object_id]
        return bool(gone)

    def selection(self, stamp_ns: int) -> Selection:
        """Return everything that is selected, the oldest first."""
        self._selections += 1
        objects = tuple(
            SelectedObject(id=object_id, user=entry.user, since_ns=entry.since_ns)
            for object_id, entry in self._entries.items()
        )
        return Selection(stamp_ns=stamp_ns, seq=self._selections, objects=objects)

    def _event(
        self, event: _Event, object_id: str, kind: str, user: str, stamp_ns: int, *, reason: str = ""
    ) -> SelectionEvent:
        self._events += 1
        return SelectionEvent(
            stamp_ns=stamp_ns,
            seq=self._events,
            event=event,
            object_id=object_id,
            kind=kind,
            user=user,
            reason=reason,
        )
