"""Colours of pixels, each one number: which differ in brightness alone, and which may be one's own."""

import contextlib
import functools
import math

import numpy as np

from pointit.geometry.colormap import UnknownColormapError, colormap
from pointit.schemas import UserProfile

HUE_TOLERANCE = 0.09
"""How far a colour may lie beside another one, as a share, to be taken for it, whatever the brightness."""
DARKEST = 0.04
"""As a share of its full colour; what is darker is no cursor."""
TINTS = 32
"""Colours of a colormap that are told apart."""

Color = tuple[int, int, int]


class OwnColor:
    """One's own colour, or colours."""

    def __init__(self, profile: UserProfile) -> None:
        """Know the cursor's colours from `profile`."""
        self._own = np.array([profile.cursor_color], dtype=np.float64)
        if profile.cursor_colormap:
            with contextlib.suppress(UnknownColormapError):  # then it is drawn in its colour
                tints = colormap(profile.cursor_colormap)(np.linspace(0.0, 1.0, TINTS))
                self._own = tints.astype(np.float64)
        self._shares: dict[int, float] = {0: 0.0}
        """By colour seen: how bright a cursor of one's own it would be, 0 when it is none."""

    def share(self, code: int) -> float:
        """Return how bright a cursor of one's own is that looks like this, as a share; 0: none."""
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
    """Return the brightest of red, green and blue, 0 to 255."""
    return max(rgb(code))


@functools.lru_cache(maxsize=4096)
def is_same_hue(code: int, other: int) -> bool:
    """Return True if two colours differ in brightness alone."""
    a, b = rgb(code), rgb(other)
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    lengths = math.hypot(*a) * math.hypot(*b)
    return lengths > 0.0 and dot >= lengths * math.cos(HUE_TOLERANCE)
