"""Outputs to the person about their interaction: changed states, and cues."""

from collections import deque
from typing import Literal

from pointit.schemas import NS_PER_S, Feedback, Interaction
from pointit.schemas.cues import MOST_FLASHES, SIGNS, Cue

State = Literal["idle", "localizing", "pointing"]


class InteractionPublisher:
    """Numbers states and cues, and skips unchanged states."""

    def __init__(self) -> None:
        self._shown: tuple[State, str, str, tuple[str, ...], bool] | None = None
        self._seq = 0
        self._cues = 0
        self._flashes_ns = deque[int](maxlen=MOST_FLASHES)
        """Times of the last cues with a colour, ns."""

    def show(
        self,
        now_ns: int,
        state: State,
        reason: str,
        next_step: str,
        ahead: tuple[str, ...] = (),
        *,
        is_unsure: bool = False,
    ) -> list[Interaction]:
        """Return the state of the interaction, unless it equals the last one."""
        update = (state, reason, next_step, ahead, is_unsure)
        if update == self._shown:
            return []
        self._seq += 1
        self._shown = update
        return [
            Interaction(
                stamp_ns=now_ns,
                seq=self._seq,
                state=state,
                next_step=next_step,
                reason=reason,
                ahead=ahead,
                is_unsure=is_unsure,
            )
        ]

    def cue(self, now_ns: int, cue: Cue, text: str, target_id: str = "", *, waits: bool = False) -> Feedback:
        """Return a cue. It comes without its colour if lamps would flash too often."""
        self._cues += 1
        sign = SIGNS[cue]._asdict()
        sign["color"] = sign["color"] if self._may_flash(now_ns) else None
        return Feedback(
            stamp_ns=now_ns, seq=self._cues, cue=cue, text=text, target_id=target_id, waits=waits, **sign
        )

    def _may_flash(self, now_ns: int) -> bool:
        flashes_ns = self._flashes_ns
        if len(flashes_ns) == MOST_FLASHES and 0 <= now_ns - flashes_ns[0] < NS_PER_S:
            return False
        flashes_ns.append(now_ns)
        return True
