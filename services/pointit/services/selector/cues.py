"""What a person hears, feels and sees when something is selected, deselected or refused."""

from typing import Literal

from pointit.schemas import Feedback
from pointit.schemas.cues import SIGNS

Kind = Literal["selected", "deselected", "refused"]


def make_cue(kind: Kind, text: str, stamp_ns: int, seq: int) -> Feedback:
    """Return the cue with the signs of the table."""
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
