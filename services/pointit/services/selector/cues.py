"""Cues that a person hears, feels and sees when an object is selected, deselected or refused."""

from typing import Literal

from pointit.schemas import Feedback
from pointit.schemas.cues import SIGNS

Kind = Literal["selected", "deselected", "refused"]


def make_cue(kind: Kind, text: str, stamp_ns: int, seq: int) -> Feedback:
    """Return the multimodal cue of `kind`, as defined in `SIGNS`."""
    sign = SIGNS[kind]
    return Feedback(
        stamp_ns=stamp_ns,
        seq=seq,
        cue=kind,
        text=text,
        chime=sign.chime,
        haptic_ms=sign.haptic_ms,
        color=sign.color,
    )
