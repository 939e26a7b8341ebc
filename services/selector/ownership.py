"""Owners and reservations of objects, the effect of staying on one, and undo."""

import functools
from collections import deque
from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass
from typing import TypedDict, Unpack

from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import NS_PER_S, ReservedObject, SelectedObject, Selection
from pointit.schemas.environment import ThingMode
from pointit.services.selector.acts import Acts
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.object_positions import ObjectPositions
from pointit.services.selector.selection_publisher import Action, Cause, Event, Owned, Record

MAX_RELEASED = 100
"""Limit of deselected objects whose last owner is remembered."""
MAX_STAMPED = 10_000
"""Limit of objects whose last change is remembered. More than a site can track."""


MakeOwner = Callable[[int], Owned]
"""Returns the owner that an object gets by an event, given the stamp of the event, ns."""


class Why(TypedDict, total=False):
    """Fields of a record that give the reason."""

    cause: Cause
    confidence: float | None
    reason: str


@dataclass(frozen=True, slots=True)
class ObjectChange:
    """Change of one object by one action, or its refusal."""

    object_id: str
    before: Owned | None
    """Owner before it, or None if the object was not selected."""
    after: Owned | None
    """Owner after it. A refusal leaves the owner as it is."""
    records: tuple[Record, ...]
    """Records of it, in order. A take-over is first deselected, then selected."""

    @property
    def is_refused(self) -> bool:
        """Return True if nothing has changed."""
        return self.records[0].event == "refused"

    @property
    def is_switched(self) -> bool:
        """Return True if the object was selected or deselected, False if at most its owner has changed."""
        return (self.before is None) is not (self.after is None)


class Ledger:
    """The selected objects. Each has one owner, and only its owner deselects it.

    Anyone may deselect what belongs to a person who is gone, and a release deselects any object. Every action
    of a person can be undone by them, step by step, the latest first.
    """

    def __init__(
        self,
        is_gone: Callable[[str, int], bool],
        too_late: Callable[[str, int], str] = lambda _object_id, _now_ns: "",
        mode: Callable[[str], ThingMode] = lambda _object_id: "claim",
        *,
        undo_steps: int = 20,
    ) -> None:
        """Create with nothing selected.

        Args:
            is_gone: returns True if a person has gone at a time, ns.
            too_late: returns the reason for which an object cannot be (de)selected at a time, or `""`.
            mode: returns the effect of selecting an object.
            undo_steps: number of steps to remember per person.
        """
        self._is_gone = is_gone
        self._too_late = too_late
        self._mode = mode
        self._undo_steps = undo_steps
        self._entries: dict[str, Owned] = {}
        self._steps: dict[str, deque[list[ObjectChange]]] = {}
        self._released: dict[str, Owned] = {}
        """Entries of the objects deselected last."""
        self._stamps_ns: dict[str, int] = {}
        """Stamp of the last event of each object, the one that changed longest ago first, ns."""

    @property
    def entries(self) -> Mapping[str, Owned]:
        """Return the selected objects by id, in no order."""
        return self._entries

    def objects(self) -> tuple[SelectedObject, ...]:
        """Return the selected objects, the oldest first, also after an undo has brought some back."""
        selected: list[SelectedObject] = []
        for object_id, entry in sorted(self._entries.items(), key=lambda item: item[1].since_ns):
            selected_object = SelectedObject(
                id=object_id,
                user=entry.user,
                since_ns=entry.since_ns,
                kind=entry.kind,
                confidence=entry.confidence,
            )
            selected.append(selected_object)
        return tuple(selected)

    def blocking_owner(self, object_id: str, user: str, now_ns: int) -> str:
        """Return the owner that blocks `user` from changing `object_id`, or `""` if nobody does."""
        entry = self._entries.get(object_id)
        if entry is None or entry.user == user:
            return ""
        return "" if self._is_gone(entry.user, now_ns) else entry.user

    def changed_ns(self, object_id: str) -> int:
        """Return the time of the last change of `object_id`, ns. 0 if none is known."""
        stamp_ns = self._stamps_ns.get(object_id, 0)
        entry = self._entries.get(object_id)
        return stamp_ns if entry is None else max(stamp_ns, entry.since_ns)

    def restore(self, entries: Mapping[str, Owned]) -> None:
        """Replace the selected objects by `entries`."""
        self._entries = dict(entries)

    def toggle(
        self,
        object_id: str,
        kind: str,
        user: str,
        now_ns: int,
        *,
        cause: Cause = "dwell",
        confidence: float | None = None,
        reason: str = "",
    ) -> ObjectChange:
        """Select or deselect `object_id` for `user`.

        Refused if it belongs to another person who is present, unless anybody may change it in its mode.
        `reason`: in the record of the change.
        """
        # Refuse what belongs to another person, or is decided
        entry = self._entries.get(object_id)
        owner = ""
        if self._mode(object_id) == "claim":
            owner = self.blocking_owner(object_id, user, now_ns)
        if entry is not None and owner:
            owned_kind = entry.kind or "object"
            refusal = f"{owned_kind} is selected by {owner}; only {owner} can deselect it"
        else:
            refusal = self._too_late(object_id, now_ns)
        if refusal:
            return self.refuse(
                object_id, kind, user, now_ns, cause=cause, reason=refusal, confidence=confidence
            )

        if entry is not None:
            change = self._change(
                object_id, None, user, now_ns, cause=cause, confidence=confidence, reason=reason
            )
        else:
            make_owner = functools.partial(Owned, user, kind, confidence=confidence)
            change = self._change(object_id, make_owner, user, now_ns, cause=cause, reason=reason)
        self._remember(user, [change])
        return change

    def follow(self, object_id: str, kind: str, user: str, now_ns: int, *, reason: str = "") -> ObjectChange:
        """Select or deselect an object as its target has it, which nobody can undo."""
        make_owner: MakeOwner | None = None
        if object_id not in self._entries:
            make_owner = functools.partial(Owned, user, kind)
        return self._change(object_id, make_owner, user, now_ns, cause="", reason=reason)

    def end(self, object_id: str, now_ns: int) -> Record:
        """Deselect a selected object by itself, as a button that was shown for long enough."""
        owner = self._entries[object_id].user
        return self._deselect(object_id, owner, now_ns, cause="")

    def clear(self, user: str, now_ns: int) -> list[ObjectChange]:
        """Deselect all objects of `user` as one step. Those for which it is too late are refused."""
        changes: list[ObjectChange] = []
        step: list[ObjectChange] = []
        for object_id, entry in list(self._entries.items()):
            if entry.user != user:
                continue
            reason = self._too_late(object_id, now_ns)
            if reason:
                change = self.refuse(object_id, entry.kind, user, now_ns, cause="clear", reason=reason)
            else:
                change = self._change(object_id, None, user, now_ns, cause="clear")
                step.append(change)
            changes.append(change)
        self._remember(user, step)
        return changes

    def release(
        self, object_id: str, user: str, now_ns: int, *, take_over: bool = False
    ) -> ObjectChange | None:
        """Deselect `object_id`, regardless of its owner, or with `take_over` make `user` its owner.

        Returns None if it is not selected, or `user` would take it over from themselves. Refused if it is
        too late, except for a take-over, which does not change its bay.
        """
        before = self._entries.get(object_id)
        if before is None:
            return None
        make_owner: MakeOwner | None = None
        if take_over:
            if before.user == user:
                return None
            make_owner = functools.partial(Owned, user, before.kind)
        else:
            reason = self._too_late(object_id, now_ns)
            if reason:
                return self.refuse(object_id, before.kind, user, now_ns, cause="release", reason=reason)
        change = self._change(object_id, make_owner, user, now_ns, cause="release")
        self._remember(user, [change])
        return change

    def undoable_users(self) -> tuple[str, ...]:
        """Return the people who have a step to undo, in order of their names."""
        return tuple(sorted(user for user, steps in self._steps.items() if steps))

    def undo(self, user: str, now_ns: int, present: Container[str]) -> list[ObjectChange]:
        """Undo the last step of `user`. Return no change if there is none.

        Objects that have left since, are decided, or belong to another person by now stay as they are. If
        nothing of the step can be undone, it is refused with the reason, and the step before is next.
        `present`: ids of the present objects.
        """
        steps = self._steps.get(user)
        if not steps:
            return []
        step = steps.pop()
        undone: list[ObjectChange] = []
        for change in step:
            if not self._is_in_effect(change, present):
                continue
            # a take-over is undone at any time, as it does not change the object's bay
            if change.is_switched and self._too_late(change.object_id, now_ns):
                continue
            make_owner: MakeOwner | None = None
            if change.before is not None:
                make_owner = functools.partial(_earlier_owner, change.before)
            undone.append(self._change(change.object_id, make_owner, user, now_ns, cause="undo"))
        return undone or [self._refuse_undo(step[0], user, now_ns, present)]

    def drop(self, object_ids: Iterable[str], now_ns: int, reason: str = "") -> list[Record]:
        """Close the entries of `object_ids`, which left at `now_ns`."""
        records: list[Record] = []
        for object_id in object_ids:
            entry = self._entries.pop(object_id)
            records.append(_record("left", object_id, entry, entry.user, now_ns, reason=reason))
        return records

    def take_back(self, record: Record, now_ns: int, reason: str) -> Record | None:
        """Undo `record`, the last change of its object, which was not done. None if it is undone already."""
        object_id = record.object_id
        entry = self._entries.get(object_id)
        is_undone = (entry is None) is (record.event == "selected")
        if is_undone:
            return None
        if entry is not None:
            return self._deselect(object_id, entry.user, now_ns, cause="", reason=reason)

        # It was deselected, so its last owner has it again, as far as that is remembered
        released = self._released.get(object_id, Owned(record.owner, record.kind, 0))
        make_owner = functools.partial(Owned, released.user, released.kind, confidence=released.confidence)
        return self._select(object_id, make_owner, released.user, now_ns, cause="", reason=reason)

    def refuse(self, object_id: str, kind: str, user: str, now_ns: int, **why: Unpack[Why]) -> ObjectChange:
        """Return the refusal of an action, and change nothing."""
        entry = self._entries.get(object_id)
        owned = entry or Owned("", kind, 0)
        record = _record("refused", object_id, owned, user, now_ns, **why)
        return ObjectChange(object_id, before=entry, after=entry, records=(record,))

    def _is_in_effect(self, change: ObjectChange, present: Container[str]) -> bool:
        """Return True if `change` can be undone: nothing has changed the owner of its object since."""
        if self._mode(change.object_id) == "button":  # the map has made it one since
            return False
        entry = self._entries.get(change.object_id)
        if change.after is None:
            return entry is None and change.object_id in present
        return entry is not None and entry.user == change.after.user

    def _refuse_undo(
        self, change: ObjectChange, user: str, now_ns: int, present: Container[str]
    ) -> ObjectChange:
        """Return the refusal to undo a step, of which `change` is the first. It tells what has happened."""
        entry = self._entries.get(change.object_id)
        owned = change.before or change.after
        kind = "object"
        if owned is not None and owned.kind:
            kind = owned.kind
        if self._is_in_effect(change, present):
            reason = self._too_late(change.object_id, now_ns)
        else:
            status = "has left"
            if entry is not None:
                status = f"is {entry.user}'s by now"
            elif change.object_id in present:
                status = "is not selected any more"
            reason = f"{kind} {status}; what was done with it cannot be taken back"
        return self.refuse(change.object_id, kind, user, now_ns, cause="undo", reason=reason)

    def _remember(self, user: str, step: list[ObjectChange]) -> None:
        """Store a step for `undo`. Its changes are of different objects, so their order has no effect.

        Those of buttons are not stored: what a button started cannot be undone, and to undo its end would
        fire it again.
        """
        undoable = [change for change in step if self._mode(change.object_id) != "button"]
        if not undoable:
            return
        steps = self._steps.setdefault(user, deque(maxlen=self._undo_steps))
        steps.append(undoable)

    def _change(
        self,
        object_id: str,
        make_owner: MakeOwner | None,
        user: str,
        now_ns: int,
        **why: Unpack[Why],
    ) -> ObjectChange:
        """Give `object_id` a new owner, or none. The caller has checked that this may be done."""
        before = self._entries.get(object_id)
        records: list[Record] = []
        if before is not None:
            records.append(self._deselect(object_id, user, now_ns, **why))
        if make_owner is not None:
            records.append(self._select(object_id, make_owner, user, now_ns, **why))
        after = self._entries.get(object_id)
        return ObjectChange(object_id, before=before, after=after, records=tuple(records))

    def _select(
        self, object_id: str, make_owner: MakeOwner, user: str, now_ns: int, **why: Unpack[Why]
    ) -> Record:
        stamp_ns = self._next_stamp_ns(object_id, now_ns)
        entry = make_owner(stamp_ns)
        self._entries[object_id] = entry
        self._released.pop(object_id, None)
        why["confidence"] = entry.confidence
        return _record("selected", object_id, entry, user, stamp_ns, **why)

    def _deselect(self, object_id: str, user: str, now_ns: int, **why: Unpack[Why]) -> Record:
        stamp_ns = self._next_stamp_ns(object_id, now_ns)
        entry = self._entries.pop(object_id)
        self._released[object_id] = entry
        if len(self._released) > MAX_RELEASED:
            oldest_id = next(iter(self._released))
            del self._released[oldest_id]
        return _record("deselected", object_id, entry, user, stamp_ns, **why)

    def _next_stamp_ns(self, object_id: str, now_ns: int) -> int:
        """Return the stamp of the next event of `object_id`: `now_ns`, but later than its last event.

        Object and stamp are the number of an act, so no two events share them. Clocks do not grow between
        any two events: some are coarse, some are set back, and those of shards are of other machines.
        """
        stamp_ns = max(now_ns, self.changed_ns(object_id) + 1)
        self._stamps_ns.pop(object_id, None)  # append
        self._stamps_ns[object_id] = stamp_ns
        if len(self._stamps_ns) > MAX_STAMPED:
            oldest_id = next(iter(self._stamps_ns))
            del self._stamps_ns[oldest_id]
        return stamp_ns


def _earlier_owner(owned: Owned, _stamp_ns: int) -> Owned:
    """Return `owned`, which has its object since it had it first."""
    return owned


def _record(event: Event, object_id: str, entry: Owned, user: str, now_ns: int, **why: Unpack[Why]) -> Record:
    return Record(now_ns, event, object_id, entry.kind, user, entry.user, entry.since_ns, **why)


class Ownership:
    """Owners and reservations: the right of each person to change an object."""

    def __init__(self, config: SelectorConfig) -> None:
        self._may_deselect = config.mode == "toggle"
        self.positions = ObjectPositions(
            margin_m=config.margin_m,
            stale_after_s=config.objects_stale_after_s,
            ended_after_s=config.unseen_after_s,
            lead_s=config.lead_s,
        )
        self.presences = UserPresence(config.ownerless_after_s)
        self.acts = Acts()
        self.ledger = Ledger(self.presences.is_gone, self.refusal, self.positions.mode)
        self.reservations = Reservations(config.reserve_s)

    def is_selected(self, object_id: str | None) -> bool:
        """Return True if any person has selected the object."""
        return object_id in self.ledger.entries

    def owner(self, object_id: str) -> str:
        """Return the person who has selected the object, or `""`."""
        entry = self.ledger.entries.get(object_id)
        return "" if entry is None else entry.user

    def action(self, user: str, object_id: str, now_ns: int) -> tuple[Action, str]:
        """Return the effect of staying on an object, and the other person who has it, or `""`."""
        # Others keep what they own, and have the first turn with what they have reserved
        mode = self.positions.mode(object_id)
        if mode == "claim":
            owner = self.ledger.blocking_owner(object_id, user, now_ns)
            if owner:
                return "refuse", owner
        holder = self.reservations.holder(object_id)
        if holder and holder != user:
            return "refuse", holder

        # A selected button goes off by itself. With `select_only`, staying deselects no claim
        is_selected = object_id in self.ledger.entries
        if is_selected:
            if mode == "button":
                return "", ""
            if mode == "claim" and not self._may_deselect:
                return "", ""
        if self.refusal(object_id, now_ns):
            return "refuse", ""
        return ("deselect" if is_selected else "select"), ""

    def refusal(self, object_id: str, now_ns: int) -> str:
        """Return the reason for which an object cannot be changed at a time, or `""`."""
        event = "deselected" if object_id in self.ledger.entries else "selected"
        mode = self.positions.mode(object_id)
        reason = self.acts.refusal(object_id, event, mode)
        return reason or self.positions.too_late(object_id, now_ns)

    def follow(self, selection: Selection) -> None:
        """Adopt the owners and reservations that the site's selector has decided on."""
        entries: dict[str, Owned] = {}
        for selected in selection.objects:
            entries[selected.id] = Owned(selected.user, selected.kind, selected.since_ns, selected.confidence)
        self.ledger.restore(entries)
        self.reservations.restore(selection.reserved)


class UserPresence:
    """Detects when a person has gone: neither announced nor active for some time."""

    def __init__(self, ownerless_after_s: float) -> None:
        self._after_ns = int(ownerless_after_s * NS_PER_S)
        self._present: set[str] = set()
        self._active_ns: dict[str, int] = {}

    def on_activity(self, user: str, stamp_ns: int) -> None:
        """Record that `user` was active."""
        self._active_ns[user] = stamp_ns

    def set_present(self, user: str, now_ns: int, *, present: bool) -> None:
        """Record that `user` is announced, or no longer."""
        if present:
            self._present.add(user)
        else:
            self._present.discard(user)
        self._active_ns[user] = now_ns

    def present_users(self, now_ns: int) -> list[str]:
        """Return the people who are not gone, by name."""
        users = {*self._present, *self._active_ns}
        return sorted(user for user in users if not self.is_gone(user, now_ns))

    def is_gone(self, user: str, now_ns: int) -> bool:
        """Return True if `user` has been away long enough for others to change their objects."""
        if user in self._present:
            return False
        active_ns = self._active_ns.setdefault(user, now_ns)
        if active_ns > now_ns + MAX_AHEAD_NS:  # the clock of their machine was ahead then
            self._active_ns[user] = active_ns = now_ns
        return now_ns - active_ns >= self._after_ns


class Reservations:
    """The first person to point steadily at each object. Others see the object as taken."""

    def __init__(self, reserve_s: float) -> None:
        self._for_ns = int(reserve_s * NS_PER_S)
        self._held: dict[str, tuple[str, int]] = {}
        """By object: user, and end of the reservation, ns."""

    def holder(self, object_id: str) -> str:
        """Return the user who has reserved `object_id`, or `""`."""
        held = self._held.get(object_id)
        if held is None:
            return ""
        holder, _until_ns = held
        return holder

    def reserve(self, object_id: str, user: str, now_ns: int) -> bool:
        """Reserve `object_id` for `user`, or extend it. Return True if it was free before.

        A reservation of another user stays.
        """
        held = self._held.get(object_id)
        if held is not None:
            holder, _until_ns = held
            if holder != user:
                return False
        self._held[object_id] = (user, now_ns + self._for_ns)
        return held is None

    def keep_last(self, user: str, count: int) -> bool:
        """Free `user`'s reservations but the last `count`. Return True if there were any."""
        own_ids = [object_id for object_id, (holder, _) in self._held.items() if holder == user]
        for object_id in own_ids[:-count]:
            del self._held[object_id]
        return len(own_ids) > count

    def extend(self, user: str, object_id: str, now_ns: int) -> bool:
        """Extend `user`'s reservation of `object_id`. Return False if they have none."""
        if self.holder(object_id) != user:
            return False
        was_free = self.reserve(object_id, user, now_ns)
        return not was_free

    def restore(self, reserved: Iterable[ReservedObject]) -> None:
        """Replace all reservations by `reserved`."""
        self._held = {reservation.id: (reservation.user, reservation.until_ns) for reservation in reserved}

    def free(self, object_id: str) -> bool:
        """Free `object_id`. Return True if it was reserved."""
        return self._held.pop(object_id, None) is not None

    def expire(self, now_ns: int) -> bool:
        """Free expired reservations. Return True if there were any.

        A reservation that ends later than possible was made by another machine's clock.
        """
        last_ns = now_ns + self._for_ns + NS_PER_S
        expired_ids: list[str] = []
        for object_id, (_user, until_ns) in self._held.items():
            if not now_ns <= until_ns <= last_ns:
                expired_ids.append(object_id)
        for object_id in expired_ids:
            del self._held[object_id]
        return bool(expired_ids)

    def objects(self) -> tuple[ReservedObject, ...]:
        """Return all reservations."""
        reserved: list[ReservedObject] = []
        for object_id, (user, until_ns) in self._held.items():
            reserved.append(ReservedObject(id=object_id, user=user, until_ns=until_ns))
        return tuple(reserved)
