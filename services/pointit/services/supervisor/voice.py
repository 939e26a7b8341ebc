"""What the person hears and sees of their interaction: states that are news, and cues."""

from typing import Literal

from pointit.schemas import Feedback, Interaction

State = Literal["idle", "localizing", "pointing"]
Cue = Literal["started", "stopped", "target", "localized", "refused"]


class Voice:
    """Counts what is said, and says no state twice."""

    def __init__(self) -> None:
        self._shown: tuple[State, str, str] | None = None
        self._seq = 0
        self._cues = 0

    def show(self, now_ns: int, state: State, reason: str, next_step: str) -> list[Interaction]:
        """Return where the person is, unless that is what was said last."""
        news = (state, reason, next_step)
        if news == self._shown:
            return []
        self._seq += 1
        self._shown = news
        return [Interaction(stamp_ns=now_ns, seq=self._seq, state=state, next_step=next_step, reason=reason)]

    def cue(self, now_ns: int, cue: Cue, text: str) -> Feedback:
        """Return a cue."""
        self._cues += 1
        return Feedback(stamp_ns=now_ns, seq=self._cues, cue=cue, text=text)
