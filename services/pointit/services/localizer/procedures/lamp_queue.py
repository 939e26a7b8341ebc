"""Queue for lamps, which serve one person at a time, in order of request.

The queue is decentralized: each localizer decides from the messages of the others. A localization states
which lamp is lit, or for which users it waits (`Localization.ahead`). Two people share lamps when one points
at a lamp of the other's, when one waits for the other, or when both wait for the same user.

Pure: messages of all localizers and the time go in; the users ahead come out.
"""

from collections.abc import Collection
from dataclasses import dataclass

from pointit.schemas import NS_PER_S, Localization

FRESH_S = 3.0
"""Age after which a localization counts as ended; active ones are published once a second."""

SETTLE_S = 0.2
"""Time after beginning in which a person yields to those who asked earlier and wait."""

MAX_HEARD = 64
"""Largest number of remembered people; those not heard for longest are dropped."""

MAX_LAMPS = 64
"""Largest number of remembered lamps of one localization."""


@dataclass(frozen=True, slots=True)
class _Heard:
    """Last message of another person's localizer."""

    at_ns: int
    since_ns: int
    ahead: tuple[str, ...]
    """Users for whom they wait; () if they point or are idle."""
    target_id: str
    lamps: frozenset[str]
    """Lamps at which they have pointed in this localization."""
    is_on: bool
    """True while they wait or point."""


class LampQueue:
    """Localizations of other people."""

    def __init__(self, user: str = "") -> None:
        self._user = user
        self._heard: dict[str, _Heard] = {}
        """Those not heard for longest come first."""

    def on_localization(self, user: str, news: Localization, now_ns: int) -> bool:
        """Store the message of `user`'s localizer. Return True if it ends a localization of theirs."""
        before = self._heard.pop(user, None)
        if news.phase == "idle":  # a new localizer: the old one's localization has ended
            return before is not None and before.is_on
        is_on = news.phase == "sampling"
        is_same = before is not None and (before.since_ns == news.since_ns or not is_on)
        lamps = before.lamps if before is not None and is_same else frozenset[str]()
        if news.target_id and len(lamps) < MAX_LAMPS:
            lamps |= {news.target_id}
        self._heard[user] = _Heard(
            at_ns=now_ns,
            since_ns=news.since_ns,
            ahead=news.ahead if is_on else (),
            target_id=news.target_id,
            lamps=lamps,
            is_on=is_on,
        )
        while len(self._heard) > MAX_HEARD:
            del self._heard[next(iter(self._heard))]
        return before is not None and before.is_on and not is_on

    def leave(self, user: str) -> bool:
        """Remove `user`. Return True if they were localized or waited."""
        before = self._heard.pop(user, None)
        return before is not None and before.is_on

    def pointing(self, lamps: Collection[str], now_ns: int) -> list[tuple[int, str]]:
        """Return start (ns) and id of the users who point at lamps shared with a user who needs `lamps`."""
        return sorted(
            (heard.since_ns, user)
            for user, heard in self._heard.items()
            if self._is_fresh(heard, now_ns) and not heard.ahead and self._shares(heard, lamps)
        )

    def ahead(self, lamps: Collection[str], since_ns: int, now_ns: int) -> tuple[str, ...]:
        """Return the users before ours, who wants `lamps` since `since_ns`: those who point come first."""
        pointing = [user for _, user in self.pointing(lamps, now_ns)]
        return (*pointing, *(user for _, user in self._waiting(lamps, since_ns, now_ns)))

    def must_yield_to(
        self, lamps: Collection[str], since_ns: int, begun_ns: int, now_ns: int
    ) -> tuple[str, ...]:
        """Return the users to whom ours, pointing since `begun_ns`, must yield `lamps`; mostly ().

        Ours requested them at `since_ns`. Of two who point, the later request yields. A person who has only
        just begun yields to everyone with an earlier request.
        """
        earlier = [user for key, user in self.pointing(lamps, now_ns) if (key, user) < (since_ns, self._user)]
        if earlier or not 0 <= now_ns - begun_ns < SETTLE_S * NS_PER_S:
            return tuple(earlier)
        return tuple(user for _, user in self._waiting(lamps, since_ns, now_ns))

    def _waiting(self, lamps: Collection[str], since_ns: int, now_ns: int) -> list[tuple[int, str]]:
        return sorted(
            (heard.since_ns, user)
            for user, heard in self._heard.items()
            if self._is_fresh(heard, now_ns)
            and heard.ahead
            and (heard.since_ns, user) < (since_ns, self._user)
            and self._shares(heard, lamps)
        )

    @staticmethod
    def _is_fresh(heard: _Heard, now_ns: int) -> bool:
        return heard.is_on and 0 <= now_ns - heard.at_ns < FRESH_S * NS_PER_S

    def _shares(self, heard: _Heard, lamps: Collection[str]) -> bool:
        """Return True if the other person is known to use some of `lamps`, or is in one queue with ours.

        What is unknown counts as not shared until they point.
        """
        if any(lamp in lamps for lamp in heard.lamps):
            return True
        if self._user in heard.ahead:
            return True
        others = (self._heard.get(user) for user in heard.ahead)
        return any(lamp in lamps for other in others if other is not None for lamp in other.lamps)


def queue_timeout_message(user: str, ahead: Collection[str], limit_s: float) -> str:
    """Return the reason why `user` stops waiting."""
    who = ", ".join(ahead) or "nobody"
    return (
        f"{user} has waited {limit_s:g} s for the lamps; {who} came first: see that they come to an end, "
        "then start again"
    )


def in_turn(user: str, ahead: Collection[str]) -> str:
    """Return a message that `user` waits for others."""
    return f"{user} waits in turn: {', '.join(ahead)} first"
