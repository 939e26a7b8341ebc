"""What a phone tells its person: cues for ear and skin, the state of the interaction, what to do next."""

from pointit.bridges.web.wire import Cue
from pointit.schemas import Feedback, Interaction, Localization

LOST = "somebody else moves your arm now: take it back when you want to"


class Cues:
    """One person's cues, and the state that a phone is told that comes later."""

    def __init__(self) -> None:
        """Begin with nothing known."""
        self._state = ""
        self._next_step = ""
        self._told: tuple[str, str, str] = ("idle", "", "")

    @property
    def current(self) -> Cue:
        """Return the state without chime and text."""
        return Cue(state=self._state, next_step=self._next_step)

    def say(self, text: str) -> Cue:
        """Return `text` as a cue."""
        return self.current.model_copy(update={"text": text})

    def loss(self) -> Cue:
        """Return that somebody else has taken the arm."""
        return self.say(LOST).model_copy(update={"has_lost_arm": True})

    def feedback(self, feedback: Feedback) -> Cue:
        """Return a cue of the bus for the phone."""
        return self.say(feedback.text).model_copy(
            update={"chime": feedback.chime, "haptic_ms": feedback.haptic_ms}
        )

    def interaction(self, interaction: Interaction) -> Cue | None:
        """Return the new state, or none where it is as before."""
        before = (self._state, self._next_step)
        self._state, self._next_step = interaction.state, interaction.next_step
        return None if before == (self._state, self._next_step) else self.current

    def localization(self, progress: Localization) -> Cue | None:
        """Return what changes for the person: another target, or why it was refused; else none."""
        now = (progress.phase, progress.target_id, progress.reason)
        if now == self._told:
            return None
        self._told = now
        if progress.phase == "sampling" and progress.target_id:
            of = (
                f", {progress.target_index + 1} of {progress.target_count}"
                if progress.target_count > 1
                else ""
            )
            return self.say(f"point at {progress.target_id}{of}")
        if progress.phase == "refused":
            return self.say(progress.reason)
        return None
