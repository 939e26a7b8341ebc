"""Limit of the claims that each person may make in a second. Pure."""

from collections import Counter

from pointit.schemas import NS_PER_S, Claim
from pointit.schemas.expiring_dict import ExpiringDict

MAX_CLAIMS = 10
"""Maximum claims of a kind per person and second: nobody points at more objects."""

WARNING_NS = 10 * NS_PER_S
"""Time for which a warning names people who claimed more, ns."""

MAX_NAMED = 5
"""Maximum number of people whom the warning names."""


class ClaimBudget:
    """Counts the claims of each person in the current second."""

    def __init__(self) -> None:
        self._second = 0
        self._claimed: Counter[tuple[str, str]] = Counter()
        self._exceeded = ExpiringDict[str, None](WARNING_NS, max_keys=MAX_NAMED)

    def allows(self, user: str, claim: Claim, now_ns: int) -> bool:
        """Count a claim. Return False if it is one too many."""
        second = now_ns // NS_PER_S
        if second != self._second:
            self._second = second
            self._claimed.clear()
        self._claimed[user, claim.wish] += 1
        if self._claimed[user, claim.wish] <= MAX_CLAIMS:
            return True
        self._exceeded.put(user, None, now_ns)
        return False

    def problem(self, now_ns: int) -> str:
        """Return a warning about people who have claimed too much recently, or `""`."""
        self._exceeded.expire(now_ns)
        if not self._exceeded:
            return ""
        names = ", ".join(sorted(self._exceeded))
        return f"more than {MAX_CLAIMS} claims a second of {names} are ignored: check their selector"
