"""What a phone tells its person: cues for ear and skin, the state of the interaction, what to do next."""

from typing import Any

from pointit.bridges.web.wire import Cue
from pointit.schemas import Feedback, Interaction, Localization

LOST = "somebody else moves your arm now: take it back when you want to"
RETURNED = "your arm does not follow this phone any more, it is your own again: take it when you want to"

STEPS = 20
"""In which progress is told."""


class Cues:
    """One person's cues, and the state that a phone is told that comes later."""

    def __init__(self) -> None:
        """Begin with nothing known."""
        self._current = Cue()
        self._told: tuple[str, str, str] = ("idle", "", "")

    @property
    def current(self) -> Cue:
        """Return the state without chime and text."""
        return self._current

    def say(self, text: str) -> Cue:
        """Return `text` as a cue."""
        return self.current.model_copy(update={"text": text})

    def loss(self, *, is_own: bool = False) -> Cue:
        """Return that the arm was taken from the phone; `is_own`: nobody else here moves it now."""
        return self.say(RETURNED if is_own else LOST).model_copy(update={"has_lost_arm": True})

    def feedback(self, feedback: Feedback) -> Cue:
        """Return a cue of the bus for the phone."""
        return self.say(feedback.text).model_copy(
            update={"chime": feedback.chime, "haptic_ms": feedback.haptic_ms}
        )

    def interaction(self, interaction: Interaction) -> Cue | None:
        """Return the new state, or none where it is as before."""
        return self._change(
            state=interaction.state, next_step=interaction.next_step, wants_double=interaction.is_unsure
        )

    def localization(self, news: Localization) -> Cue | None:
        """Return what changes for the person: target, progress, why it was refused; else none."""
        is_aiming = news.phase == "sampling" and bool(news.target_id) and not news.ahead
        changed = self._change(progress=round(STEPS * news.progress) / STEPS if is_aiming else None)
        now = (news.phase, news.target_id, news.reason)
        if now == self._told:
            return changed
        self._told = now
        if is_aiming:
            is_one_of = (
                news.target_count > 1 and not news.candidates
            )  # else that is how many robots there are
            which = f", {news.target_index + 1} of {news.target_count}" if is_one_of else ""
            return self.say(f"point at {news.target_id}{which}")
        if news.phase == "refused":
            return self.say(news.reason)
        return changed

    def _change(self, **fields: Any) -> Cue | None:
        """Return the state with `fields` changed, or none where they are as before."""
        before, self._current = self._current, self._current.model_copy(update=fields)
        return None if self._current == before else self._current
