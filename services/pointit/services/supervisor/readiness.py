"""What a sample of the wrist may begin by itself: with `autostart` all, else what was broken off."""

from typing import Literal

from pointit.schemas import NS_PER_S, Interaction, Localization

LAST_WORD_PURPOSE = "interaction"
"""Under this name the supervisor's last word is kept, a file for each person."""

GRACE_NS = 2 * NS_PER_S
"""A localization that was asked for begins within."""


class Readiness:
    """Knows why nothing goes on."""

    def __init__(self, *, autostart: bool, retry_s: float, resume_s: float) -> None:
        self._autostarts = autostart
        self._retry_ns = round(retry_s * NS_PER_S)
        self._resume_ns = round(resume_s * NS_PER_S)
        self.is_eager = autostart
        """Whether a sample may begin; not after the person stopped themselves."""
        self._not_before_ns = 0
        self._resume_until_ns: int | None = None

    def wait(self, until_ns: int) -> None:
        """Begin nothing before `until_ns`."""
        self._not_before_ns = until_ns

    def fail(self, now_ns: int) -> None:
        """Take note that localizing has failed."""
        self._not_before_ns = now_ns + self._retry_ns

    def gesture(self, *, ends: bool) -> None:
        """Take note that the person used the button: what they end stays ended."""
        self.is_eager = self._autostarts and not ends
        self._resume_until_ns = None

    def on_interrupted(self, now_ns: int) -> None:
        """Take note that pointing was broken off, though the person did not want to stop."""
        self._resume_until_ns = now_ns + self._resume_ns

    def may_begin(self, now_ns: int) -> bool:
        """Return whether a sample may do what a press would."""
        return self.is_eager and now_ns >= self._not_before_ns

    def may_resume(self, now_ns: int) -> bool:
        """Return whether a sample may take pointing up again."""
        return self._resume_until_ns is not None and now_ns < self._resume_until_ns

    def set_back(self, by_ns: int) -> None:
        """Take that the clock was set back."""
        self._not_before_ns -= by_ns
        if self._resume_until_ns is not None:
            self._resume_until_ns -= by_ns


class InteractionResume:
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

    def resumable_activity(self, news: Localization) -> Literal["", "localizing", "pointing"]:
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
