"""Presence of people: announced, or recently active."""

from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import NS_PER_S


class UserPresence:
    """Detects when a person has gone: neither announced nor active for some time."""

    def __init__(self, ownerless_after_s: float) -> None:
        self._after_ns = int(ownerless_after_s * NS_PER_S)
        self._present: set[str] = set()
        self._heard_ns: dict[str, int] = {}

    def on_activity(self, user: str, stamp_ns: int) -> None:
        """Record that `user` was active."""
        self._heard_ns[user] = stamp_ns

    def set_present(self, user: str, now_ns: int, *, present: bool) -> None:
        """Record that `user` is announced, or no longer."""
        (self._present.add if present else self._present.discard)(user)
        self._heard_ns[user] = now_ns

    def there(self, now_ns: int) -> list[str]:
        """Return the people who are not gone, by name."""
        return sorted(user for user in {*self._present, *self._heard_ns} if not self.is_gone(user, now_ns))

    def is_gone(self, user: str, now_ns: int) -> bool:
        """Return True if `user` has been away for so long that anyone may change what is theirs."""
        if user in self._present:
            return False
        heard_ns = self._heard_ns.setdefault(user, now_ns)
        if heard_ns > now_ns + MAX_AHEAD_NS:
            self._heard_ns[user] = heard_ns = now_ns
        return now_ns - heard_ns >= self._after_ns
