"""What a supervisor was about that was killed: its successor takes it up where nothing else has changed.

That is so when the person's localizer is the one of before: what it said last, it said before the killed
supervisor's last word. In a run that begins anew it begins anew as well.
"""

from typing import Literal

from pointit.schemas import NS_PER_S, Interaction, Localization

LAST_WORD_PURPOSE = "interaction"
"""Under this name the supervisor's last word is kept, a file for each person."""

GRACE_NS = 2 * NS_PER_S
"""A localization that was asked for begins within."""


class TakingUp:
    """Waits for the localizer's first word."""

    def __init__(self) -> None:
        self._before: Interaction | None = None

    def take(self, before: Interaction, now_ns: int) -> None:
        """Take what was said last; what is yet to come is of another time."""
        if before.stamp_ns <= now_ns and (self._before is None or before.stamp_ns > self._before.stamp_ns):
            self._before = before

    def forget(self) -> None:
        """Take note that the person has done something else."""
        self._before = None

    def goes_on(self, news: Localization) -> Literal["", "localizing", "pointing"]:
        """Return what goes on, now that the localizer has said `news`: asked a second time, nothing."""
        before, self._before = self._before, None
        if before is None or before.state == "idle":
            return ""
        if before.state == "pointing":
            return "pointing" if news.stamp_ns <= before.stamp_ns else ""
        is_same = news.purpose == "pose" and 0 < news.since_ns <= before.stamp_ns + GRACE_NS
        if not is_same or news.phase not in {"sampling", "solved"}:
            return ""
        return "localizing" if news.phase == "sampling" else "pointing"
