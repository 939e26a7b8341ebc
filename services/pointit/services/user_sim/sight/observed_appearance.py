"""Appearance of a thing from its pixels: their colours, marks of people, brightness of selected things."""

import contextlib
import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pointit.geometry.colormap import UnknownColormapError, colormap
from pointit.schemas import UserProfile

HUE_TOLERANCE = 0.09
"""Maximum distance of a colour from another one of any brightness, as a share, to count as equal."""

DARKEST = 0.04
"""Minimum brightness of a cursor, as a share of its full colour."""

TINTS = 32
"""Number of distinct colours of a colormap."""

Color = tuple[int, int, int]

FULL = 1.5
"""Minimum brightness of a selected thing relative to others, which is at least 2 as drawn."""

GAP = 0.6
"""Maximum relative brightness of a pixel of the pattern of a selected thing."""

BRIGHTER = 1.2
"""Minimum brightness of an own mark relative to a thing of the same colour. Selected ones are 1.27 darker."""

UNKNOWN_DIM = 105.0
"""Brightness of unselected things of a kind that was never seen unmarked."""


class OwnColor:
    """The person's own colour, or colours."""

    def __init__(self, profile: UserProfile) -> None:
        self._own = np.array([profile.cursor_color], dtype=np.float64)
        if profile.cursor_colormap:
            with contextlib.suppress(UnknownColormapError):  # it is drawn in `cursor_color`
                tints = colormap(profile.cursor_colormap)(np.linspace(0.0, 1.0, TINTS))
                self._own = tints.astype(np.float64)
        self._shares: dict[int, float] = {0: 0.0}
        """By colour: brightness of an own cursor of this colour, 0 if it is none."""

    def share(self, code: int) -> float:
        """Return the brightness of an own cursor that looks like this, as a share, or 0 if it is none."""
        share = self._shares.get(code)
        if share is None:
            if len(self._shares) > 4096:
                self._shares = {0: 0.0}
            share = self._shares[code] = self._share_of(rgb(code))
        return share

    def _share_of(self, color: Color) -> float:
        pixel = np.array(color, dtype=np.float64)
        squares = np.maximum(np.einsum("ij,ij->i", self._own, self._own), 1.0)
        shares = self._own @ pixel / squares
        beside = np.linalg.norm(pixel - shares[:, None] * self._own, axis=1)
        off = beside / np.maximum(shares * np.sqrt(squares), 1e-9)
        best = int(np.argmin(off))
        return float(shares[best]) if off[best] <= HUE_TOLERANCE and shares[best] >= DARKEST else 0.0


def rgb(code: int) -> Color:
    """Return red, green and blue of a pixel's code."""
    return (code >> 16, code >> 8 & 255, code & 255)


def brightness(code: int) -> int:
    """Return the maximum of red, green and blue, 0 to 255."""
    return max(rgb(code))


@functools.lru_cache(maxsize=4096)
def is_same_hue(code: int, other: int) -> bool:
    """Return True if two colours differ in brightness only."""
    a, b = rgb(code), rgb(other)
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    lengths = math.hypot(*a) * math.hypot(*b)
    return lengths > 0.0 and dot >= lengths * math.cos(HUE_TOLERANCE)


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
        is_own_hue = own_color.share(body) > 0.0  # then only brightness tells the own marks from the thing
        if is_plain[0] and is_plain[-1] and (not is_own_hue or len(set(shown)) == 1):
            usual = _commonest(bodies)
            self._dim[kind] = (usual, brightness(usual))
            return ObservedAppearance(marked=False, full=False, hidden=False, own=False, foreign=False)
        dimmest = min(map(brightness, bodies), default=0)
        ends = [
            code
            for code in (shown[0], shown[-1])
            if not is_same_hue(code, body) or (is_own_hue and brightness(code) > BRIGHTER * dimmest)
        ]
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
