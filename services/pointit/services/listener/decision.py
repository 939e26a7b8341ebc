"""Decision to act on a word, or to ask the person if it is not clear enough."""

from collections.abc import Collection, Sequence
from typing import Literal, NamedTuple

from pointit.schemas import Referent, Referents

SURE = 0.85
"""Probability from which what is most probable is taken as meant."""
ASKED = 0.25
"""Probability from which a candidate is asked about."""
EACH = 0.5
"""Probability from which one of `these` is taken as meant: each is, or is not, whatever the others are."""
EITHER = 0.6
"""Probability of two candidates together from which the person is asked which one is meant."""
REACTION_S = 0.3
"""Time from seeing the light of a candidate to the answer to it, s."""


class Decision(NamedTuple):
    """Next step for a word: act, ask which one is meant, or refuse."""

    do: Literal["act", "ask", "refuse"]
    candidates: Sequence[Referent]
    """The referents, or those to ask about, the most probable first. Empty if refused.

    Their probabilities are those among what fits.
    """


def decide(
    found: Referents,
    kinds: Sequence[str] = (),
    names: Collection[str] | None = None,
    *,
    several: bool = False,
) -> Decision:
    """Return the next step for a word with these referents.

    Only `kinds` fit, or any if empty, and only `names`, or any if None. Candidates that do not fit are
    excluded by what was said, and the others become more probable, but not more than they are beside `none`.
    A word that may mean `several` has independent candidates: it acts on each by itself, and never asks.
    """
    kept = [one for one in found.candidates if not kinds or one.kind in kinds]
    fitting = [one for one in kept if names is None or one.name in names]
    if several:
        certain = [one for one in fitting if one.probability >= EACH]
        return Decision("act" if certain else "refuse", certain)
    total = found.none + sum(one.probability for one in fitting)
    if not fitting or total <= 0.0:
        return Decision("refuse", ())
    chances = [min(one.probability / total, 1.0) for one in fitting]
    fitting = [
        one.model_copy(update={"probability": chance}) for one, chance in zip(fitting, chances, strict=True)
    ]
    if chances[0] >= SURE:
        return Decision("act", fitting[:1])
    if chances[0] < ASKED or sum(chances[:2]) < EITHER:
        return Decision("refuse", ())
    return Decision("ask", fitting[: 2 if len(chances) > 1 and chances[1] >= (1.0 - SURE) / 2.0 else 1])
