"""Conditions for a sample of the wrist to start pointing: `autostart`, or an interruption."""

from typing import Literal

from pointit.schemas import NS_PER_S, Interaction, Localization
from pointit.services.supervisor.config import SupervisorConfig

LAST_WORD_PURPOSE = "interaction"
"""Name of the file of a person's last interaction."""
GRACE_NS = 2 * NS_PER_S
"""Time within which a requested localization begins, ns."""


class Readiness:
    """Decides if a sample may start or resume pointing."""

    def __init__(self, config: SupervisorConfig) -> None:
        self._autostarts = config.autostart
        self._retry_ns = round(config.retry_s * NS_PER_S)
        self._resume_ns = round(config.resume_s * NS_PER_S)
        self.is_eager = config.autostart
        """True if a sample may start pointing. False after the person stopped."""
        self._not_before_ns = 0
        self._resume_until_ns: int | None = None

    def wait(self, until_ns: int) -> None:
        """Block starts until `until_ns`."""
        self._not_before_ns = until_ns

    def fail(self, now_ns: int) -> None:
        """Record that localizing has failed."""
        self._not_before_ns = now_ns + self._retry_ns

    def gesture(self, *, ends: bool) -> None:
        """Record a gesture. One that ends pointing disables the automatic start."""
        self.is_eager = self._autostarts and not ends
        self._resume_until_ns = None

    def on_interrupted(self, now_ns: int) -> None:
        """Record that pointing was interrupted against the person's intention."""
        self._resume_until_ns = now_ns + self._resume_ns

    def may_begin(self, now_ns: int) -> bool:
        """Return True if a sample may act like a press."""
        return self.is_eager and now_ns >= self._not_before_ns

    def may_resume(self, now_ns: int) -> bool:
        """Return True if a sample may resume pointing."""
        return self._resume_until_ns is not None and now_ns < self._resume_until_ns


class InteractionResume:
    """Keeps the last interaction of an earlier supervisor until the localizer's first message."""

    def __init__(self) -> None:
        self._before: Interaction | None = None

    def take(self, before: Interaction, now_ns: int) -> None:
        """Store the last interaction. One with a future stamp is ignored."""
        if before.stamp_ns <= now_ns and (self._before is None or before.stamp_ns > self._before.stamp_ns):
            self._before = before

    def forget(self) -> None:
        """Discard it, as the person has done something else."""
        self._before = None

    def resumable_activity(self, localization: Localization) -> Literal["", "localizing", "pointing"]:
        """Return the activity to resume after the localizer's message `localization`, or `""`. Works once."""
        before, self._before = self._before, None
        if before is None or before.state == "idle":
            return ""
        if before.state == "pointing":
            return "pointing" if localization.stamp_ns <= before.stamp_ns else ""
        is_same = localization.purpose == "pose" and 0 < localization.since_ns <= before.stamp_ns + GRACE_NS
        if not is_same or localization.phase not in {"sampling", "solved"}:
            return ""
        return "localizing" if localization.phase == "sampling" else "pointing"
