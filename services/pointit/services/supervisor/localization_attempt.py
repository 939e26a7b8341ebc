"""One localization or anchor that goes on, as the person sees it: whom they wait for, what to point at.

Pure: the localizer's news go in; what they mean for this search comes out.
"""

from typing import Literal

from pointit.schemas import Localization
from pointit.services.supervisor import user_messages
from pointit.services.supervisor.interaction_publisher import State

Purpose = Literal["pose", "anchor"]

Failure = Literal["refused", "cancelled", "lost"]
Meaning = Literal["nothing", "aim", "found", "restarted"] | Failure
"""`aim`: what to do, or whom to wait for, may have changed; `restarted`: the localizer knows nothing of it;
`lost`: it does something else."""


_OF_ANCHORS: dict[Failure, str] = {
    "refused": user_messages.ANCHOR_REFUSED,
    "cancelled": user_messages.ANCHOR_CANCELLED,
    "lost": user_messages.ANCHOR_LOST,
}
_OF_POSES: dict[Failure, str] = {
    "refused": user_messages.REFUSED,
    "cancelled": user_messages.CANCELLED,
    "lost": user_messages.POSE_LOST,
}


class LocalizationAttempt:
    """Begins when it is asked for; by the person, or by somebody else: then it is joined when it goes on."""

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
        """Begin.

        Args:
            run: counts the searches.
            purpose: what for.
            since_ns: news from before are not of this one.
            now_ns: the time-out counts from here, or from when the waiting ends.
            then: where it leads when it succeeds.
            otherwise: where, when it does not.
            is_joined: somebody else has asked for it.
        """
        self.run = run
        self.purpose = purpose
        self.state_on_success = then
        self.state_on_failure = otherwise
        self.is_joined = is_joined
        self.is_answered = is_joined
        """Whether the localizer has consented; what ends before that is an earlier one."""
        self.since_ns = since_ns
        self.counted_ns = now_ns
        """From when the time-out counts: the last target that followed another, or the begin."""
        self.next_step = user_messages.WAIT
        self.ahead: tuple[str, ...] = ()
        self.target_id = ""
        """What is to be pointed at now."""
        self._reached = 0
        """Highest index of a target so far."""
        self._aimed: tuple[int, int] | None = None
        """Of which localization which target was told."""

    @property
    def is_owned_by_requester(self) -> bool:
        """Return whether its time-outs are those of who asked for it."""
        return self.is_joined and self.purpose == "pose"

    def again(self, run: int) -> None:
        """Begin again in its place and time: the localizer was restarted."""
        self.run = run
        self.is_answered = False
        self.next_step = user_messages.WAIT
        self.ahead, self.target_id, self._aimed = (), "", None

    def set_back(self, by_ns: int) -> None:
        """Take that the clock was set back."""
        self.since_ns -= by_ns
        self.counted_ns -= by_ns

    def classify(self, news: Localization, pose_ns: int | None) -> Meaning:
        """Return what `news` mean for it.

        Args:
            news: of the person's localizer.
            pose_ns: stamp of the newest pose; none: none is known.
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

    def failure_reason(self, failure: Failure, told: str = "") -> str:
        """Return why it came to nothing; what was `told` says it best, of what still is this search."""
        if told and failure != "lost":
            return told
        if self.purpose == "anchor":
            return _OF_ANCHORS[failure]
        if failure == "cancelled" and self.is_joined:
            return user_messages.POSE_CANCELLED
        return _OF_POSES[failure]

    def follow(self, news: Localization, now_ns: int) -> bool:
        """Take what is to be done now; return whether that asks for a cue: once a target.

        The robot that seems to be meant may change while the person follows theirs; that is no new target.
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
        if news.target_index > self._reached:  # many lamps take longer than one may take
            self._reached, self.counted_ns = news.target_index, now_ns
        aimed, self._aimed = self._aimed, (news.since_ns, news.target_index)
        self.next_step = user_messages.aim(news)
        self.target_id = news.target_id
        return aimed != self._aimed
