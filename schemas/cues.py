"""Signs of each cue for the ear, the skin and the eye.

Cues differ in all three, so that each sense alone tells them apart. The colours are of Okabe and Ito's
palette (Color Universal Design, 2008), distinguishable by colour-blind people, and differ in lightness.
"""

from typing import Literal, NamedTuple

from pointit.schemas.base import Rgb

Cue = Literal["started", "stopped", "target", "localized", "refused", "selected", "deselected"]
Chime = Literal["", "up", "down", "single", "double", "buzz", "tick", "tock"]

MAX_FLASHES = 3
"""In a second: more can cause seizures (WCAG 2.2, 2.3.1)."""


class MultimodalCue(NamedTuple):
    """A cue for the ear, the skin and the eye, with the fields of `Feedback`."""

    chime: Chime
    haptic_ms: tuple[int, ...]
    """On, off, on ..."""
    color: Rgb


SIGNS: dict[Cue, MultimodalCue] = {
    "started": MultimodalCue("up", (80,), (0, 114, 178)),  # blue
    "stopped": MultimodalCue("down", (250,), (213, 94, 0)),  # vermilion
    "target": MultimodalCue("single", (60, 80, 60), (240, 228, 66)),  # yellow
    "localized": MultimodalCue("double", (60, 80, 60, 80, 60), (0, 158, 115)),  # bluish green
    "refused": MultimodalCue("buzz", (400, 150, 400), (204, 121, 167)),  # reddish purple
    "selected": MultimodalCue("tick", (30,), (230, 159, 0)),  # orange
    "deselected": MultimodalCue("tock", (150, 60, 40), (130, 205, 255)),  # sky blue, lighter than orange
}
