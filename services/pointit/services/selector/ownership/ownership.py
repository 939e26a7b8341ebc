"""Owners and reservations of objects, and the effect of staying on one: decided here, or followed."""

from pointit.schemas import Selection
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.objects.object_positions import ObjectPositions
from pointit.services.selector.outputs import Action, Owned
from pointit.services.selector.ownership.ledger import Ledger
from pointit.services.selector.ownership.reservations import Reservations
from pointit.services.selector.ownership.user_presence import UserPresence


class Ownership:
    """Owners and reservations: the right of each person to change an object."""

    def __init__(self, config: SelectorConfig) -> None:
        """Create with nothing selected or reserved, no people and no objects."""
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
        owner = self.ledger.blocking_owner(object_id, user, now_ns)
        if owner:
            return "refuse", owner
        holder = self.reservations.holder(object_id)
        if holder and holder != user:
            return "refuse", holder
        is_selected = object_id in self.ledger.entries
        if is_selected and not self._may_deselect:
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
