"""Beliefs of the simulated person about objects."""

from typing import Literal

from pointit.schemas import NS_PER_S
from pointit.services.user_sim.eyes import ObservedAppearance

Status = Literal["free", "mine", "theirs", "taken"]

SURE_S = 0.6
"""Time for which a thing with a cursor over its middle must look the same to be believed, s, as the
gauge fills its ends first."""
PASSING_S = 0.25
"""Time below which another person's cursor has only passed, s."""
FELT_S = 0.4
"""Time for which a cue overrides what is seen, s."""
MAX_THINGS = 10_000
"""Limit of the number of things."""


class PerceivedObjects:
    """Beliefs by id. Cues count at once, what is seen when it is certain."""

    def __init__(self) -> None:
        self._status: dict[str, Status] = {}
        self._maybe: dict[str, tuple[Status, int]] = {}
        """Apparent new status of a thing, and the time since which it appears."""
        self._felt_ns: dict[str, int] = {}

    def status(self, object_id: str) -> Status:
        """Return the believed status of a thing. New ones are free."""
        return self._status.get(object_id, "free")

    def believe(self, object_id: str, status: Status, now_ns: int) -> None:
        """Set the status, as given by a cue."""
        if len(self._status) > MAX_THINGS:
            self._status.clear()
            self._felt_ns.clear()
            self._maybe.clear()
        self._status[object_id] = status
        self._felt_ns[object_id] = now_ns
        self._maybe.pop(object_id, None)

    def see(self, object_id: str, appearance: ObservedAppearance | None, now_ns: int) -> None:
        """Process the appearance of a thing. None: it is not visible enough."""
        if appearance is None:
            return
        felt_ns = self._felt_ns.get(object_id)
        if felt_ns is not None and 0 <= now_ns - felt_ns < FELT_S * NS_PER_S:
            return
        believed = self.status(object_id)
        apparent = _apparent_status(appearance, believed)
        if apparent == believed:
            self._maybe.pop(object_id, None)
            return

        # Time since which it appears so
        previous, since_ns = self._maybe.get(object_id, (apparent, now_ns))
        if previous != apparent or since_ns > now_ns:
            since_ns = now_ns
        self._maybe[object_id] = (apparent, since_ns)

        # Believe it when it has lasted long enough: own marks come and go with the own cursor
        is_own_mark = appearance.own and appearance.marked
        is_unsure = appearance.hidden or is_own_mark
        wait_s = SURE_S if is_unsure else 0.0
        if apparent == "taken":
            wait_s = max(wait_s, PASSING_S)
        if now_ns - since_ns >= wait_s * NS_PER_S:
            del self._maybe[object_id]
            self._status[object_id] = apparent


def _apparent_status(appearance: ObservedAppearance, believed: Status) -> Status:
    if not appearance.marked:
        return "free"
    if not appearance.full:
        return "taken" if appearance.foreign else "free"
    if appearance.own and not appearance.foreign:
        return "mine"
    # it is another's, perhaps with a white end as the owner's profile is unknown, or both overlap there
    return believed if believed in ("mine", "theirs") else "theirs"
