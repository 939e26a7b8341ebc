"""What an operator is shown of refusals and limits: each identity's newest sentence of each kind; pure."""

from collections.abc import Mapping

RECENT_S = 20.0
"""So long a sentence is shown after it was last true: somebody has to see it."""
MOST_SENTENCES = 20


class RecentDenials:
    """Keeps the newest sentence of each identity and kind."""

    def __init__(self) -> None:
        self._told: dict[tuple[str, str], tuple[str, float]] = {}
        """By identity (`SITE/NAME`) and kind, the oldest first: the sentence, and when it was true, s."""

    def add(self, sentences: Mapping[str, str], now_s: float, kind: str = "") -> None:
        """Add sentences by identity and forget old ones.

        Args:
            sentences: by identity. Each replaces the earlier sentence of the same identity and kind.
            now_s: when they are true, on any monotonic clock.
            kind: what they are about. A sentence that is repeated, such as that an identity is cut off, hides
                nothing of another kind.
        """
        for name, sentence in sentences.items():
            self._told.pop((name, kind), None)
            self._told[name, kind] = (sentence, now_s)
        self._told = {key: told for key, told in self._told.items() if now_s - told[1] <= RECENT_S}

    def of(self, site: str) -> tuple[str, ...]:
        """Return what is to be shown at `site`, the newest first: of its identities and of nobody's."""
        there = [
            sentence
            for (name, _), (sentence, _) in reversed(self._told.items())
            if name.startswith(f"{site}/") or "/" not in name
        ]
        return tuple(there[:MOST_SENTENCES])
