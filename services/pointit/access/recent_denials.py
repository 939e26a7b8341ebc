"""Denials and limits for the operator: the newest message of each identity and kind. Pure."""

from collections.abc import Mapping

RECENT_S = 20.0
"""Time for which a message is shown after it was last true, s."""
MAX_MESSAGES = 20


class RecentDenials:
    """Keeps the newest message of each identity and kind."""

    def __init__(self) -> None:
        self._messages: dict[tuple[str, str], tuple[str, float]] = {}
        """By identity (`SITE/NAME`) and kind, the oldest first: message, and time at which it was true, s."""

    def add(self, sentences: Mapping[str, str], now_s: float, kind: str = "") -> None:
        """Add messages by identity and forget old ones.

        Each replaces the earlier one of the same identity and kind: a repeated message, such as that an
        identity is cut off, does not hide others. `now_s`: on any monotonic clock.
        """
        for name, sentence in sentences.items():
            self._messages.pop((name, kind), None)
            self._messages[name, kind] = (sentence, now_s)
        self._messages = {key: entry for key, entry in self._messages.items() if now_s - entry[1] <= RECENT_S}

    def of(self, site: str) -> tuple[str, ...]:
        """Return the messages for `site`, the newest first: those of its identities and of unknown ones."""
        there = [
            sentence
            for (name, _), (sentence, _) in reversed(self._messages.items())
            if name.startswith(f"{site}/") or "/" not in name
        ]
        return tuple(there[:MAX_MESSAGES])
