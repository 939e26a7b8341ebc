"""What an operator is shown of who was refused what: each identity's newest sentence, for a while; pure."""

from collections.abc import Mapping

RECENT_S = 20.0
"""So long a sentence is shown after it was last true: somebody has to see it."""
MOST_SENTENCES = 20


class Recent:
    """Keeps the newest sentence of each identity."""

    def __init__(self) -> None:
        self._told: dict[str, tuple[str, float]] = {}
        """By identity, `SITE/NAME`, the one longest silent first: the sentence, and when it was true, s."""

    def add(self, sentences: Mapping[str, str], now_s: float) -> None:
        """Take sentences by identity, true at `now_s` (any monotonic clock); forget what is old."""
        for name, sentence in sentences.items():
            self._told.pop(name, None)
            self._told[name] = (sentence, now_s)
        self._told = {name: told for name, told in self._told.items() if now_s - told[1] <= RECENT_S}

    def of(self, site: str) -> tuple[str, ...]:
        """Return what is to be shown at `site`, the newest first: of its identities and of nobody's."""
        there = [
            sentence
            for name, (sentence, _) in reversed(self._told.items())
            if name.startswith(f"{site}/") or "/" not in name
        ]
        return tuple(there[:MOST_SENTENCES])
