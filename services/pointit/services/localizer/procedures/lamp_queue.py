"""Whose turn it is: lamps serve one person at a time, who asked first is served first.

Nobody leads the queue: every localizer decides for itself from what it hears of the others. Who is localized
says which lamp is lit; who waits says whom they wait for (`Localization.ahead`). Two people share lamps when
one points at a lamp of the other's, when one waits for the other, or when they wait for the same.

Pure: what everybody's localizers say and the time go in; who comes before comes out.
"""

from collections.abc import Collection
from dataclasses import dataclass

from pointit.schemas import NS_PER_S, Localization

FRESH_S = 3.0
"""Who has said nothing for so long is not localized any more; who is, or waits, says so once a second."""

SETTLE_S = 0.2
"""So soon after beginning, who hears of somebody that asked earlier, and waits, lets them go first."""

MAX_HEARD = 64
"""Of more people, the ones longest unheard are forgotten."""

MAX_LAMPS = 64
"""Of more lamps of one localization, as many are remembered."""


@dataclass(frozen=True, slots=True)
class _Heard:
    """What somebody's localizer said last."""

    at_ns: int
    since_ns: int
    ahead: tuple[str, ...]
    """For whom they wait; empty: they point, or nothing goes on."""
    target_id: str
    lamps: frozenset[str]
    """At which they have pointed in this localization."""
    is_on: bool
    """Whether they wait or point; else it is over."""


class LampQueue:
    """What is heard of other people's localizations."""

    def __init__(self, user: str = "") -> None:
        self._user = user
        self._heard: dict[str, _Heard] = {}
        """The longest unheard first."""

    def on_localization(self, user: str, news: Localization, now_ns: int) -> bool:
        """Take what `user`'s localizer says. Return True if a localization of theirs has ended with it."""
        before = self._heard.pop(user, None)
        if news.phase == "idle":  # a new localizer: what the old one did is over
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
        """Take note that `user` is not present any more. Return True if they were localized, or waited."""
        before = self._heard.pop(user, None)
        return before is not None and before.is_on

    def pointing(self, lamps: Collection[str], now_ns: int) -> list[tuple[int, str]]:
        """Return since when (ns) and who points at lamps that they share with who needs `lamps`."""
        return sorted(
            (heard.since_ns, user)
            for user, heard in self._heard.items()
            if self._is_fresh(heard, now_ns) and not heard.ahead and self._shares(heard, lamps)
        )

    def ahead(self, lamps: Collection[str], since_ns: int, now_ns: int) -> tuple[str, ...]:
        """Return who comes before our person, who wants `lamps` since `since_ns`: those who point first."""
        pointing = [user for _, user in self.pointing(lamps, now_ns)]
        return (*pointing, *(user for _, user in self._waiting(lamps, since_ns, now_ns)))

    def must_yield_to(
        self, lamps: Collection[str], since_ns: int, begun_ns: int, now_ns: int
    ) -> tuple[str, ...]:
        """Return to whom our person must leave `lamps`, at which they point since `begun_ns`; mostly nobody.

        They are wanted since `since_ns`. Of two who point, who asked later yields; and who has only just
        begun, to everybody who asked earlier.
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
        """Return True if they, as far as is known, use some of `lamps`, or are in one queue with us.

        What is not known is taken to be so: it is until they point.
        """
        if any(lamp in lamps for lamp in heard.lamps):
            return True
        if self._user in heard.ahead:
            return True
        others = (self._heard.get(user) for user in heard.ahead)
        return any(lamp in lamps for other in others if other is not None for lamp in other.lamps)


def queue_timeout_message(user: str, ahead: Collection[str], limit_s: float) -> str:
    """Return why `user` waits no longer."""
    who = ", ".join(ahead) or "nobody"
    return (
        f"{user} has waited {limit_s:g} s for the lamps; {who} came first: see that they come to an end, "
        "then start again"
    )


def in_turn(user: str, ahead: Collection[str]) -> str:
    """Return that `user` waits for others."""
    return f"{user} waits in turn: {', '.join(ahead)} first"
