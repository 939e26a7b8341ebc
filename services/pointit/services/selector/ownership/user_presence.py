"""Who is there: who has said so, and who was heard of lately."""

from pointit.schemas import NS_PER_S

AHEAD_NS = NS_PER_S
"""Who was heard of later in the future than this was heard of by a clock that has been set back since."""


class UserPresence:
    """Knows when a person has gone: neither announced nor heard of for some time."""

    def __init__(self, ownerless_after_s: float) -> None:
        self._after_ns = int(ownerless_after_s * NS_PER_S)
        self._present: set[str] = set()
        self._heard_ns: dict[str, int] = {}

    def on_activity(self, user: str, stamp_ns: int) -> None:
        """Take note that `user` did something."""
        self._heard_ns[user] = stamp_ns

    def set_present(self, user: str, now_ns: int, *, present: bool) -> None:
        """Take note that `user` is announced, or no longer."""
        (self._present.add if present else self._present.discard)(user)
        self._heard_ns[user] = now_ns

    def is_gone(self, user: str, now_ns: int) -> bool:
        """Return whether `user` has been away for so long that what is theirs is anybody's."""
        if user in self._present:
            return False
        heard_ns = self._heard_ns.setdefault(user, now_ns)
        if heard_ns > now_ns + AHEAD_NS:
            self._heard_ns[user] = heard_ns = now_ns
        return now_ns - heard_ns >= self._after_ns
