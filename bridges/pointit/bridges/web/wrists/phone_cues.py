"""Cues of a phone: sound and vibration, the state of the interaction, instructions."""

from typing import Any

from pointit.bridges.web.wire import Cue
from pointit.schemas import Announced, Feedback, Interaction, Localization, Understood

LOST = "another device moves your arm now: take it back when you want to"
RETURNED = "your arm does not follow this phone any more, it is your own again: take it when you want to"

STEPS = 20
"""Number of steps in which progress is sent."""


class Cues:
    """One person's cues, and the current state for a phone that connects later."""

    def __init__(self) -> None:
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
        """Return the cue that the phone has lost the arm; `is_own`: to the person's own device."""
        return self.say(RETURNED if is_own else LOST).model_copy(update={"has_lost_arm": True})

    def feedback(self, feedback: Announced | Feedback | Understood) -> Cue | None:
        """Return a cue of the bus for the phone, or None: no name is to be spoken."""
        if isinstance(feedback, Announced):
            return self.current.model_copy(update={"announced": feedback.label}) if feedback.label else None
        if isinstance(feedback, Understood):
            return self.say(f'"{feedback.text}": {feedback.message or feedback.result}')
        return self.say(feedback.text).model_copy(
            update={"chime": feedback.chime, "haptic_ms": feedback.haptic_ms}
        )

    def interaction(self, interaction: Interaction) -> Cue | None:
        """Return the new state, or None if it is unchanged."""
        return self._change(
            state=interaction.state, next_step=interaction.next_step, wants_double=interaction.is_unsure
        )

    def localization(self, news: Localization) -> Cue | None:
        """Return changes for the person (target, progress, reason of a refusal), or None."""
        is_aiming = news.phase == "sampling" and bool(news.target_id) and not news.ahead
        changed = self._change(progress=round(STEPS * news.progress) / STEPS if is_aiming else None)
        now = (news.phase, news.target_id, news.reason)
        if now == self._told:
            return changed
        self._told = now
        if is_aiming:
            is_one_of = (
                news.target_count > 1 and not news.candidates
            )  # otherwise that is the number of robots
            which = f", {news.target_index + 1} of {news.target_count}" if is_one_of else ""
            return self.say(f"point at {news.target_id}{which}")
        if news.phase == "refused":
            return self.say(news.reason)
        return changed

    def _change(self, **fields: Any) -> Cue | None:
        before, self._current = self._current, self._current.model_copy(update=fields)
        return None if self._current == before else self._current
