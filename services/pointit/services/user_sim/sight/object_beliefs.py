"""What the person holds to be true of each thing: free, theirs, somebody else's, or just being taken."""

from typing import Literal

from pointit.schemas import NS_PER_S
from pointit.services.user_sim.sight.observed_appearance import ObservedAppearance

Status = Literal["free", "mine", "theirs", "taken"]

SURE_S = 0.6
"""How long a thing with a cursor over its middle must look so before it is believed: the gauge fills its
ends first."""
PASSING_S = 0.25
"""Somebody else's cursor that is gone sooner has only passed."""
FELT_S = 0.4
"""How long what was felt counts more than what is seen."""
MOST = 10_000
"""Things that are remembered."""


class ObjectBeliefs:
    """Remembers; what is felt counts at once, what is seen once it is sure."""

    def __init__(self) -> None:
        self._status: dict[str, Status] = {}
        self._maybe: dict[str, tuple[Status, int]] = {}
        """What a thing seems to have become, and since when."""
        self._felt_ns: dict[str, int] = {}

    def status(self, object_id: str) -> Status:
        """Return what is believed of a thing; of one that is new: it is free."""
        return self._status.get(object_id, "free")

    def believe(self, object_id: str, status: Status, now_ns: int) -> None:
        """Believe it now, as it was felt."""
        if len(self._status) > MOST:
            self._status.clear()
            self._felt_ns.clear()
            self._maybe.clear()
        self._status[object_id] = status
        self._felt_ns[object_id] = now_ns
        self._maybe.pop(object_id, None)

    def see(self, object_id: str, looks: ObservedAppearance | None, now_ns: int) -> None:
        """Take in how a thing looks; none: it cannot be made out."""
        if looks is None:
            return
        felt_ns = self._felt_ns.get(object_id)
        if felt_ns is not None and 0 <= now_ns - felt_ns < FELT_S * NS_PER_S:
            return
        before = self.status(object_id)
        seems = _seems(looks, before)
        if seems == before:
            self._maybe.pop(object_id, None)
            return
        was, since_ns = self._maybe.get(object_id, (seems, now_ns))
        if was != seems or since_ns > now_ns:
            since_ns = now_ns
        self._maybe[object_id] = (seems, since_ns)
        wait_s = SURE_S if looks.hidden or (looks.own and looks.marked) else 0.0
        if seems == "taken":
            wait_s = max(wait_s, PASSING_S)
        if now_ns - since_ns >= wait_s * NS_PER_S:
            del self._maybe[object_id]
            self._status[object_id] = seems


def _seems(looks: ObservedAppearance, before: Status) -> Status:
    if not looks.marked:
        return "free"
    if not looks.full:
        return "taken" if looks.foreign else "free"
    if looks.own and not looks.foreign:
        return "mine"
    # somebody's, with a white end perhaps because nobody knows the owner's colour, or both ours meet there
    return before if before in ("mine", "theirs") else "theirs"
