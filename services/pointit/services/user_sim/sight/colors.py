"""Colours of pixels as integers: equal hues, and the person's own colours."""

import contextlib
import functools
import math

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


class OwnColor:
    """The person's own colour, or colours."""

    def __init__(self, profile: UserProfile) -> None:
        """Create with the cursor's colours of `profile`."""
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
