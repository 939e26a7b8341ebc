"""One localization or anchor in progress, as the person sees it: queue, target and next step.

Pure: it classifies the localizer's messages for this attempt.
"""

from typing import Literal

from pointit.schemas import Localization
from pointit.services.supervisor import user_messages
from pointit.services.supervisor.interaction_publisher import State

Purpose = Literal["pose", "anchor"]

Failure = Literal["refused", "cancelled", "lost"]
Meaning = Literal["nothing", "aim", "found", "restarted"] | Failure
"""Meaning of a message. `aim`: target or queue may have changed. `restarted`: the localizer does not know
the attempt. `lost`: it does something else."""


_ANCHOR_FAILURES: dict[Failure, str] = {
    "refused": user_messages.ANCHOR_REFUSED,
    "cancelled": user_messages.ANCHOR_CANCELLED,
    "lost": user_messages.ANCHOR_LOST,
}
_POSE_FAILURES: dict[Failure, str] = {
    "refused": user_messages.REFUSED,
    "cancelled": user_messages.CANCELLED,
    "lost": user_messages.POSE_LOST,
}


class LocalizationAttempt:
    """An attempt requested by the person, or joined if requested by another client."""

    def __init__(
        self,
        run: int,
        purpose: Purpose,
        *,
        since_ns: int,
        now_ns: int,
        then: State,
        otherwise: State,
        is_joined: bool = False,
    ) -> None:
        """Start the attempt.

        Args:
            run: number of the attempt.
            purpose: purpose of the attempt.
            since_ns: earlier messages do not belong to it.
            now_ns: start of the timeout, which restarts when waiting ends.
            then: next state on success.
            otherwise: next state on failure.
            is_joined: True if another client requested it.
        """
        self.run = run
        self.purpose = purpose
        self.state_on_success = then
        self.state_on_failure = otherwise
        self.is_joined = is_joined
        self.is_answered = is_joined
        """True if the localizer has accepted it. What ends before that is an earlier one."""
        self.since_ns = since_ns
        self.counted_ns = now_ns
        """Start of the timeout, ns: the last change of target, or the start."""
        self.next_step = user_messages.WAIT
        self.ahead: tuple[str, ...] = ()
        self.target_id = ""
        """Current target, or `""`."""
        self._reached = 0
        """Highest index of a target so far."""
        self._aimed: tuple[int, int] | None = None
        """`(since_ns, target_index)` of the last target announced to the person, or None."""

    @property
    def is_owned_by_requester(self) -> bool:
        """Return True if its timeouts are those of the client that requested it."""
        return self.is_joined and self.purpose == "pose"

    def restart(self, run: int) -> None:
        """Restart it, keeping its times, as the localizer was restarted."""
        self.run = run
        self.is_answered = False
        self.next_step = user_messages.WAIT
        self.ahead, self.target_id, self._aimed = (), "", None

    def classify(self, news: Localization, pose_ns: int | None) -> Meaning:
        """Return the meaning of `news` for this attempt.

        Args:
            news: message of the person's localizer.
            pose_ns: stamp of the newest pose. None: no pose is known.
        """
        if news.stamp_ns < self.since_ns:
            return "nothing"
        if news.purpose != self.purpose:
            is_other = self.purpose == "anchor" and self.is_answered
            return "lost" if is_other else "nothing"
        if news.phase == "sampling":
            return "aim"
        if news.phase == "solved":
            return "found"
        if news.phase == "refused":
            return "refused"
        if not self.is_answered:  # cancelled or idle before it heard of this one
            return "nothing"
        if news.phase == "cancelled":
            return "cancelled"
        if self.is_joined:
            return "lost"
        is_unseen = pose_ns is not None and pose_ns >= self.since_ns
        return "found" if is_unseen else "restarted"  # idle, as if it had never heard of us

    def failure_reason(self, failure: Failure, given: str = "") -> str:
        """Return the reason of a failure: the localizer's if `given`, unless it is lost, or a default."""
        if given and failure != "lost":
            return given
        if self.purpose == "anchor":
            return _ANCHOR_FAILURES[failure]
        if failure == "cancelled" and self.is_joined:
            return user_messages.POSE_CANCELLED
        return _POSE_FAILURES[failure]

    def follow(self, news: Localization, now_ns: int) -> bool:
        """Update target and queue. Return True if a cue is due, once per target.

        A change of the robot's candidate while the person follows theirs is no new target.
        """
        self.ahead = news.ahead
        if news.ahead:
            self.counted_ns = now_ns
            self.next_step = user_messages.queue(news.ahead)
            was_aimed, self._aimed, self.target_id = self._aimed is not None, None, ""
            return was_aimed
        if not news.target_id:
            if not self.target_id:
                self.next_step = user_messages.WAIT
            return False
        if news.target_index > self._reached:  # the timeout is per lamp
            self._reached, self.counted_ns = news.target_index, now_ns
        aimed, self._aimed = self._aimed, (news.since_ns, news.target_index)
        self.next_step = user_messages.aim(news)
        self.target_id = news.target_id
        return aimed != self._aimed
