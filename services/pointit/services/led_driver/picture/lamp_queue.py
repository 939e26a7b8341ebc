"""Queue for lamps, which serve one person at a time, in order of request.

led-driver alone decides. Localizers state which lamps they use and which one is to be lit
(`Localization.lamps`, `target_id`), again every second, so that a restarted led-driver restores the queue.
"""

from typing import NamedTuple

from pointit.schemas import NS_PER_S, LampLease, Localization

FRESH_NS = 3 * NS_PER_S
"""Age after which a localization by lamps counts as ended, ns. Active ones are published once a second."""
MAX_PEOPLE = 64
"""Limit of people. Beyond it the one silent for longest is forgotten."""


class LampService(NamedTuple):
    """Lamps as they are shared out."""

    leases: tuple[LampLease, ...] = ()
    """Lamps of each person, and the order of the waiting users."""
    targets: frozenset[str] | set[str] = frozenset()
    """Ids of the lamps to light."""


class LampQueue:
    """Localizations of all people, and the lamps that each may use. Pure."""

    def __init__(self, silence_ns: int) -> None:
        """Create without people. `silence_ns`: age after which a localization without lamps has ended."""
        self._silence_ns = silence_ns
        self._active: dict[str, tuple[int, Localization]] = {}
        """By user: time of arrival, ns, and last message. Those silent for longest come first."""

    def on_localization(self, user: str, localization: Localization, now_ns: int) -> None:
        """Set the state of `user`'s localization."""
        self._active.pop(user, None)
        if localization.phase == "sampling":
            self._active[user] = (now_ns, localization)
        while len(self._active) > MAX_PEOPLE:
            del self._active[next(iter(self._active))]

    def leave(self, user: str) -> None:
        """Remove `user`, who or whose localizer has left."""
        self._active.pop(user, None)

    def expire(self, now_ns: int) -> None:
        """Remove localizations that have sent nothing for longer than the timeout."""
        self._active = {
            user: (at_ns, localization)
            for user, (at_ns, localization) in self._active.items()
            if 0 <= now_ns - at_ns < self._timeout_ns(localization)
        }

    def next_expiry_ns(self) -> int | None:
        """Return the time of the next expiry without new messages, or None."""
        return min(
            (at_ns + self._timeout_ns(localization) for at_ns, localization in self._active.values()),
            default=None,
        )

    @property
    def is_in_use(self) -> bool:
        """True if anybody localizes rather than waits."""
        return any(not localization.ahead for _, localization in self._active.values())

    def service(self) -> LampService:
        """Return the order of people, those who point before those who wait, and the lamps to light."""
        # those who point come first: clocks differ, so a later request may state an earlier time
        wanted = (
            (bool(localization.ahead), localization.since_ns, user, localization)
            for user, (_, localization) in self._active.items()
            if localization.lamps
        )
        leases: list[LampLease] = []
        targets: set[str] = set()
        for _, since_ns, user, localization in sorted(wanted, key=lambda each: each[:3]):
            ahead = tuple(each.user for each in leases if not set(localization.lamps).isdisjoint(each.lamps))
            leases.append(LampLease(user=user, since_ns=since_ns, lamps=localization.lamps, ahead=ahead))
            if not ahead and not localization.ahead and localization.target_id in localization.lamps:
                targets.add(localization.target_id)
        return LampService(tuple(leases), targets)

    def _timeout_ns(self, localization: Localization) -> int:
        return FRESH_NS if localization.lamps else self._silence_ns
