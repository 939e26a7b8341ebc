"""How a thing looks by the light of its pixels: marked by whom, and as bright as selected things or not."""

from collections.abc import Sequence
from typing import NamedTuple

from pointit.services.user_sim.sight.colors import OwnColor, brightness, is_same_hue

FULL = 1.5
"""Times as bright as a thing that nobody selected: selected (twice and more, as it is drawn)."""

GAP = 0.6
"""Times as bright, that is darker: a pixel of the pattern of what somebody selected."""
UNKNOWN_DIM = 105.0
"""Brightness of things of a kind that was never seen unmarked."""


class ObservedAppearance(NamedTuple):
    """How a thing looks."""

    marked: bool
    """Its ends are in another colour than its middle."""
    full: bool
    """It is as bright as selected things are."""
    hidden: bool
    """A cursor lies over its middle, so that its brightness is a guess."""
    own: bool
    """An end is in one's own colour."""
    foreign: bool
    """An end is in a colour that is neither one's own nor the thing's."""


class UsualLooks:
    """Knows how things of each kind look that nobody selected, once one was seen."""

    def __init__(self) -> None:
        self._dim: dict[str, tuple[int, int]] = {}
        """By kind: colour and brightness of things that nobody selected."""

    def judge(
        self, kind: str, shown: Sequence[int], own_color: OwnColor, cursor_brightness: float
    ) -> ObservedAppearance:
        """Return how a thing looks, and learn from one that is unmarked.

        Args:
            kind: of the thing.
            shown: codes of its pixels from end to end, at least 3.
            own_color: of who looks.
            cursor_brightness: how bright cursors are of late, as a share.
        """
        known = self._dim.get(kind)
        body = known[0] if known is not None else _commonest(shown[1:-1])
        is_plain = [is_same_hue(code, body) for code in shown]
        bodies = [code for code, is_it in zip(shown, is_plain, strict=True) if is_it]
        if is_plain[0] and is_plain[-1] and not any(own_color.share(code) > 0.0 for code in shown[:2]):
            usual = _commonest(bodies)
            self._dim[kind] = (usual, brightness(usual))
            return ObservedAppearance(marked=False, full=False, hidden=False, own=False, foreign=False)
        ends = [code for code in (shown[0], shown[-1]) if not is_same_hue(code, body)]
        is_own = [own_color.share(code) > 0.0 for code in ends]
        own, foreign = any(is_own), not all(is_own)
        if not bodies:  # covered, or something else has come to lie there
            return ObservedAppearance(marked=True, full=False, hidden=True, own=own, foreign=foreign)
        dim = known[1] if known is not None else UNKNOWN_DIM * cursor_brightness
        middle = (len(shown) - 1) / 2.0
        nearest = min((k for k, is_it in enumerate(is_plain) if is_it), key=lambda k: abs(k - middle))
        level = brightness(shown[nearest])
        return ObservedAppearance(
            marked=True,
            full=level > FULL * dim or (known is not None and level < GAP * dim),
            hidden=abs(nearest - middle) > len(shown) / 6.0,
            own=own,
            foreign=foreign,
        )


def _commonest(codes: Sequence[int]) -> int:
    return max(codes, key=codes.count)
