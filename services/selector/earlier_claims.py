"""Claims of each person that were decided, so that one which comes again changes nothing. Pure."""

from collections import deque

from pointit.schemas import NS_PER_S, Claim

MAX_DECIDED = 64
"""Limit of claims that are remembered per person."""


class EarlierClaims:
    """The last decided claims of each person, and the object that they changed last by staying on it."""

    def __init__(self) -> None:
        self._decided: dict[str, deque[int]] = {}
        """Stamps of the last claims by person."""
        self._dwelt: dict[str, tuple[str, int]] = {}
        """Object that each person changed last by staying on it, and the time, ns."""

    def is_decided(self, user: str, stamp_ns: int) -> bool:
        """Return True if the claim was decided before. Remember it."""
        stamps = self._decided.setdefault(user, deque(maxlen=MAX_DECIDED))
        is_known = stamp_ns in stamps
        if not is_known:
            stamps.append(stamp_ns)
        return is_known

    def add_dwell(self, user: str, object_id: str, stamp_ns: int) -> None:
        """Note that `user` changed an object by staying on it."""
        self._dwelt[user] = object_id, stamp_ns

    def is_twice(self, user: str, claim: Claim, dwell_s: float) -> bool:
        """Return True if nobody can have stayed `dwell_s` on the object again since they changed it."""
        if user not in self._dwelt:
            return False
        object_id, stamp_ns = self._dwelt[user]
        if object_id != claim.object_id:
            return False
        return 2 * abs(claim.stamp_ns - stamp_ns) < dwell_s * NS_PER_S
