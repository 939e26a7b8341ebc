"""Colours and text of the pictures of maps. The palette is that of Okabe and Ito."""

from typing import Any

from matplotlib.patheffects import withStroke

Axes = Any
"""Matplotlib's axes. Its stubs leave the types of keywords open, which strict checkers reject."""

BELT, BELT_EDGE, ARROW, INK = "#e3e6ea", "#a4abb5", "#7c8591", "#2b2f36"
STRIP, LAMP, LINK, BAY, CLOUD = "#0072b2", "#e69f00", "#d55e00", "#009e73", "#56b4e9"
SOLID, SOLID_FILL = "#8a4a77", "#cc79a733"
"""The palette's purple, darker where it is for lines and text."""

KEEP_IN, KEEP_OUT = "#009e73", "#d55e00"

HALO: list[Any] = [withStroke(linewidth=2.5, foreground="white")]
ON_TOP: dict[str, Any] = {"path_effects": HALO, "zorder": 9}
"""Properties of text."""
