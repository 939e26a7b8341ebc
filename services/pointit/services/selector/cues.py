"""What a person hears, feels and sees when something is selected, deselected or refused."""

from typing import Literal, NamedTuple

from pointit.schemas import Feedback
from pointit.schemas.base import Rgb

Kind = Literal["selected", "deselected", "refused"]


class _Cue(NamedTuple):
    chime: Literal["up", "down", "buzz"]
    haptic_ms: tuple[int, ...]
    color: Rgb


_CUES: dict[Kind, _Cue] = {
    "selected": _Cue("up", (80,), (0, 158, 115)),
    "deselected": _Cue("down", (40, 80, 40), (86, 180, 233)),
    "refused": _Cue("buzz", (400,), (213, 94, 0)),
}
"""Colours of Okabe and Ito, told apart by the colour-blind too."""


def cue(kind: Kind, text: str, stamp_ns: int, seq: int) -> Feedback:
    """Return the cue: up and one pulse, down and two short ones, or a buzz."""
    chime, haptic_ms, color = _CUES[kind]
    return Feedback(
        stamp_ns=stamp_ns, seq=seq, cue=kind, text=text, chime=chime, haptic_ms=haptic_ms, color=color
    )
