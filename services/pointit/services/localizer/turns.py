"""Whose turn it is: the lamps of a room serve one person at a time.

Pure: what everybody's localizers say and the time go in; who has the lamps comes out.
"""

from collections.abc import Container

from pointit.schemas import NS_PER_S, Localization

FRESH_S = 3.0
"""Who has said nothing for so long is not localized any more; who is says so once a second."""

MAX_HEARD = 64
"""Of more people, the ones longest unheard are forgotten."""


class Turns:
    """What is heard of other people's localizations."""

    def __init__(self) -> None:
        self._heard: dict[str, tuple[int, Localization]] = {}
        """Of those who are localized, and when they said so."""

    def hear(self, user: str, news: Localization, now_ns: int) -> bool:
        """Take what `user`'s localizer says; return whether a localization of theirs has ended with it."""
        before = self._heard.pop(user, None)
        if news.phase == "sampling":
            self._heard[user] = (now_ns, news)
            while len(self._heard) > MAX_HEARD:
                del self._heard[next(iter(self._heard))]
        return before is not None and news.phase != "sampling"

    def others(self, lamps: Container[str], now_ns: int) -> list[tuple[int, str]]:
        """Return since when (ns) and who else is pointing at one of `lamps`, the first first."""
        return sorted(
            (news.since_ns, user)
            for user, (heard_ns, news) in self._heard.items()
            if news.target_id in lamps and 0 <= now_ns - heard_ns < FRESH_S * NS_PER_S
        )


def busy(user: str) -> str:
    """Return why somebody else cannot be localized while `user` is."""
    return f"{user} is being localized with these lamps; try again when they are done"
