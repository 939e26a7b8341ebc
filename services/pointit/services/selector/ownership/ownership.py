"""Owners and reservations of objects, and the effect of staying on one: decided here, or followed."""

from collections.abc import Iterable

from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import NS_PER_S, ReservedObject, Selection
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.objects.object_positions import ObjectPositions
from pointit.services.selector.outputs import Action, Owned
from pointit.services.selector.ownership.ledger import Ledger


class Ownership:
    """Owners and reservations: the right of each person to change an object."""

    def __init__(self, config: SelectorConfig) -> None:
        self._may_deselect = config.mode == "toggle"
        self.positions = positions = ObjectPositions(
            margin_m=config.margin_m,
            stale_after_s=config.objects_stale_after_s,
            display_lag_s=config.display_lag_s,
            ended_after_s=config.unseen_after_s,
            lead_s=config.lead_s,
        )
        self.presences = UserPresence(config.ownerless_after_s)
        self.ledger = Ledger(self.presences.is_gone, positions.too_late, undo_steps=config.undo_steps)
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
        mode = self.positions.mode(object_id)
        owner = "" if mode != "claim" else self.ledger.blocking_owner(object_id, user, now_ns)
        if owner:
            return "refuse", owner
        holder = self.reservations.holder(object_id)
        if holder and holder != user:
            return "refuse", holder
        is_selected = object_id in self.ledger.entries
        if is_selected and (mode == "button" or (mode == "claim" and not self._may_deselect)):
            return "", ""
        if self.positions.too_late(object_id, now_ns):
            return "refuse", ""
        return ("deselect" if is_selected else "select"), ""

    def follow(self, selection: Selection) -> None:
        """Take over what the site's selector has decided."""
        self.ledger.restore(
            {one.id: Owned(one.user, one.kind, one.since_ns, one.confidence) for one in selection.objects}
        )
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
        (self._present.add if present else self._present.discard)(user)
        self._active_ns[user] = now_ns

    def there(self, now_ns: int) -> list[str]:
        """Return the people who are not gone, by name."""
        return sorted(user for user in {*self._present, *self._active_ns} if not self.is_gone(user, now_ns))

    def is_gone(self, user: str, now_ns: int) -> bool:
        """Return True if `user` has been away long enough for others to change their objects."""
        if user in self._present:
            return False
        active_ns = self._active_ns.setdefault(user, now_ns)
        if active_ns > now_ns + MAX_AHEAD_NS:
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
        return "" if held is None else held[0]

    def reserve(self, object_id: str, user: str, now_ns: int) -> bool:
        """Reserve `object_id` for `user`, or extend it. Return True if it was free before.

        A reservation of another user stays.
        """
        held = self._held.get(object_id)
        if held is not None and held[0] != user:
            return False
        self._held[object_id] = (user, now_ns + self._for_ns)
        return held is None

    def keep_last(self, user: str, count: int) -> bool:
        """Free `user`'s reservations but the last `count`. Return True if there were any."""
        own = [object_id for object_id, (holder, _) in self._held.items() if holder == user]
        for object_id in own[:-count]:
            del self._held[object_id]
        return len(own) > count

    def extend(self, user: str, object_id: str, now_ns: int) -> bool:
        """Extend `user`'s reservation of `object_id`. Return False if they have none."""
        return self.holder(object_id) == user and not self.reserve(object_id, user, now_ns)

    def restore(self, reserved: Iterable[ReservedObject]) -> None:
        """Replace all reservations by `reserved`."""
        self._held = {one.id: (one.user, one.until_ns) for one in reserved}

    def free(self, object_id: str) -> bool:
        """Free `object_id`. Return True if it was reserved."""
        return self._held.pop(object_id, None) is not None

    def expire(self, now_ns: int) -> bool:
        """Free expired reservations. Return True if there were any.

        A reservation that ends later than possible was made by another machine's clock.
        """
        last_ns = now_ns + self._for_ns + NS_PER_S
        if not self._held or all(now_ns <= until_ns <= last_ns for _, until_ns in self._held.values()):
            return False
        self._held = {name: held for name, held in self._held.items() if now_ns <= held[1] <= last_ns}
        return True

    def objects(self) -> tuple[ReservedObject, ...]:
        """Return all reservations."""
        return tuple(
            ReservedObject(id=object_id, user=user, until_ns=until_ns)
            for object_id, (user, until_ns) in self._held.items()
        )
