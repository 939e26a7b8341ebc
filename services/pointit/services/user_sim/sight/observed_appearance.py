"""Appearance of a thing from its pixels: marks of people, and brightness of selected things."""

from collections.abc import Sequence
from typing import NamedTuple

from pointit.services.user_sim.sight.colors import OwnColor, brightness, is_same_hue

FULL = 1.5
"""Minimum brightness of a selected thing relative to others, which is at least 2 as drawn."""

GAP = 0.6
"""Maximum relative brightness of a pixel of the pattern of a selected thing."""
UNKNOWN_DIM = 105.0
"""Brightness of unselected things of a kind that was never seen unmarked."""


class ObservedAppearance(NamedTuple):
    """Appearance of a thing."""

    marked: bool
    """True if its ends are in another colour than its middle."""
    full: bool
    """True if it is as bright as selected things."""
    hidden: bool
    """True if a cursor covers its middle, so that its brightness is uncertain."""
    own: bool
    """True if an end is in the own colour."""
    foreign: bool
    """True if an end is in a colour that is neither the own nor the thing's."""


class UsualLooks:
    """Learned appearance of unselected things of each kind."""

    def __init__(self) -> None:
        self._dim: dict[str, tuple[int, int]] = {}
        """By kind: colour and brightness of unselected things."""

    def judge(
        self, kind: str, shown: Sequence[int], own_color: OwnColor, cursor_brightness: float
    ) -> ObservedAppearance:
        """Return the appearance of a thing, and learn from unmarked ones.

        Args:
            kind: kind of the thing.
            shown: codes of its pixels from end to end, at least 3.
            own_color: colour of the person.
            cursor_brightness: recent brightness of cursors, as a share.
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
        if not bodies:  # covered by a cursor or another thing
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
