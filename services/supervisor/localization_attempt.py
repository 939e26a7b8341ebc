"""A localization in progress, as the person sees it: queue, target and next step."""

from dataclasses import dataclass
from typing import Literal

from pointit.schemas import Localization
from pointit.services.supervisor import transitions
from pointit.services.supervisor.transitions import Event, Stage


@dataclass(kw_only=True)
class LocalizationAttempt:
    """An attempt requested by the person, or by another client."""

    stage: Stage
    """`localizing`, `anchoring` or `joined`."""
    before: Literal["idle", "pointing"]
    """Stage that preceded it."""
    since_ns: int
    """Earlier messages do not belong to it, ns."""
    counted_ns: int
    """Start of the timeout, ns: the last change of target, or the start."""
    run: int = 0
    """Number of the person's last request. 0: none."""
    is_answered: bool = True
    """True if the localizer has accepted the request. An end before that belongs to an earlier attempt."""
    next_step: str = transitions.WAIT
    ahead: tuple[str, ...] = ()
    target_id: str = ""
    """Current target, or `""`."""
    _reached: int = 0
    """Highest index of a target so far."""
    _aimed: tuple[int, int] | None = None
    """`(since_ns, target_index)` of the last target announced to the person, or None."""

    def on_request(self, run: int) -> None:
        """Wait for the localizer, which is asked for the first time or was restarted. Times are kept."""
        self.run = run
        self.is_answered = False
        self.next_step = transitions.WAIT
        self.ahead = ()
        self.target_id = ""
        self._aimed = None

    def classify(self, localization: Localization, pose_ns: int | None) -> Event | None:
        """Return the event that `localization` is for this attempt, or None.

        `pose_ns`: stamp of the newest pose. None: no pose is known.
        """
        if localization.stamp_ns < self.since_ns:
            return None
        is_anchor = self.stage == "anchoring"
        if (localization.purpose == "anchor") != is_anchor:
            # Another localization has taken the place of the anchor
            return "lost" if is_anchor and self.is_answered else None
        match localization.phase:
            case "sampling":
                return "target"
            case "solved":
                return "found"
            case "refused":
                return "refused"
            case "cancelled" | "idle" if not self.is_answered:  # before it heard of this one
                return None
            case "cancelled":
                return "cancelled"
            case "idle" if self.stage == "localizing":
                is_unseen = pose_ns is not None and pose_ns >= self.since_ns
                return "found" if is_unseen else "restarted"  # idle, as if it had never heard of us
            case "idle":
                return "lost"

    def follow(self, localization: Localization, now_ns: int) -> bool:
        """Update target and queue. Return True if a cue is due, once per target.

        A change of the robot's candidate while the person follows theirs is no new target.
        """
        self.ahead = localization.ahead
        if localization.ahead:
            self.counted_ns = now_ns
            self.next_step = transitions.queue(localization.ahead)
            was_aimed = self._aimed is not None
            self._aimed = None
            self.target_id = ""
            return was_aimed
        if not localization.target_id:
            if not self.target_id:
                self.next_step = transitions.WAIT
            return False
        if localization.target_index > self._reached:  # the timeout is per lamp
            self._reached = localization.target_index
            self.counted_ns = now_ns
        aimed = self._aimed
        self._aimed = (localization.since_ns, localization.target_index)
        self.next_step = transitions.aim(localization)
        self.target_id = localization.target_id
        return aimed != self._aimed
