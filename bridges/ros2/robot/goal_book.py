"""Sent goals of a ROS action and their outcomes, for answers in any order. Pure.

At most one goal is wanted: the newest, until the robot is stopped. Servers answer late, twice, or not at all.
The topic with the status of all goals replaces missing answers. A goal that a server executes although it is
not wanted is cancelled until the server reports its end.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from pointit.schemas import NS_PER_S

Outcome = Literal["accepted", "active", "done", "cancelled", "refused", "failed"]

MAX_GOALS = 32
"""Maximum number of goals remembered."""
GRACE_NS = 2 * NS_PER_S
"""Time in which a server that has accepted a goal ends the one before by itself."""
RESULT_NS = NS_PER_S
"""Time for a result to follow the status."""
RETRY_NS = NS_PER_S // 2
"""Interval of repeated cancellations of one goal."""

OPEN = {"sent", "silent", "accepted", "active"}
"""States of goals that the server may work on."""


class GoalStatus(IntEnum):
    """Constants of action_msgs/GoalStatus."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


ACTIVE = {GoalStatus.ACCEPTED, GoalStatus.EXECUTING, GoalStatus.CANCELING}
TERMINAL = {GoalStatus.SUCCEEDED, GoalStatus.CANCELED, GoalStatus.ABORTED}


OUTCOMES: dict[int, Outcome] = {
    GoalStatus.SUCCEEDED: "done",
    GoalStatus.CANCELED: "cancelled",
    GoalStatus.ABORTED: "failed",
}


@dataclass
class _Goal:
    state: Literal["sent", "silent", "accepted", "active", "unknown", "over"] = "sent"
    """silent: the server has not answered in time. unknown: it says that it has no such goal. over: refused,
    or ended."""
    decided_ns: int = 0
    """Time of acceptance."""
    cancelled_ns: int = 0
    """Time of the last request to cancel it."""
    received_ns: int = 0
    """Time of its last feedback."""
    end: int = GoalStatus.UNKNOWN
    """Status with which it has ended by the status topic; the result may tell why."""
    end_ns: int = 0


class GoalBook:
    """The goals of one client."""

    def __init__(self) -> None:
        self._goals: dict[bytes, _Goal] = {}
        self.wanted: bytes | None = None
        """Id of the goal that the robot is to reach."""

    def begin(self, goal: bytes) -> None:
        """Make `goal`, which is sent now, the wanted one."""
        self._goals[goal] = _Goal()
        self.wanted = goal
        for old in list(self._goals)[:-MAX_GOALS]:
            del self._goals[old]

    def drop(self) -> None:
        """Remove the wanted goal: the robot is stopped."""
        self.wanted = None

    def on_response(self, goal: bytes, *, accepted: bool, now_ns: int) -> Outcome | None:
        """Return the outcome, if any, of a server's first answer to `goal`."""
        record = self._goals.get(goal)
        if record is None or record.state not in {"sent", "silent"}:
            return None
        record.state = "accepted" if accepted else "over"
        record.decided_ns = now_ns
        if goal != self.wanted:
            record.cancelled_ns = 0  # a cancellation before its acceptance had no effect
            return None
        if accepted:
            return "accepted"
        self.wanted = None
        return "refused"

    def on_silence(self, goal: bytes) -> Outcome | None:
        """Return the outcome if a server does not answer for `goal`.

        The goal is cancelled, since it may be running.
        """
        record = self._goals.get(goal)
        if record is None or record.state not in OPEN:
            return None
        record.state = "silent"
        if goal != self.wanted:
            return None
        self.wanted = None
        return "failed"

    def on_feedback(self, goal: bytes, now_ns: int) -> Outcome | None:
        """Return the outcome, if any, of feedback about `goal`: the server works on it."""
        if goal in self._goals:
            self._goals[goal].received_ns = now_ns
        return self._on_active(goal, now_ns)

    def on_status(self, statuses: Iterable[tuple[bytes, int]], now_ns: int) -> list[Outcome]:
        """Return the outcome from a status list of goals. Goals of other clients are ignored.

        The end of the wanted goal is not an outcome yet: its result contains the reason, see `overdue`.
        """
        outcomes: list[Outcome] = []
        for goal, status in statuses:
            record = self._goals.get(goal)
            if status in ACTIVE:
                outcome = self._on_active(goal, now_ns)
                if outcome is not None:
                    outcomes.append(outcome)
            elif record is not None and status in TERMINAL:
                if goal != self.wanted:
                    record.state = "over"
                elif record.end == GoalStatus.UNKNOWN:
                    record.end = status
                    record.end_ns = now_ns
        return outcomes

    def overdue(self, now_ns: int) -> Outcome | None:
        """Return the outcome of the wanted goal by the status topic if its result has not come since."""
        if self.wanted is None:
            return None
        record = self._goals[self.wanted]
        if record.end == GoalStatus.UNKNOWN or now_ns - record.end_ns < RESULT_NS:
            return None
        return self.on_end(self.wanted, record.end)

    def is_reported(self, goal: bytes, now_ns: int) -> bool:
        """Return True if there was feedback about `goal` just now."""
        record = self._goals.get(goal)
        return record is not None and now_ns - record.received_ns < GRACE_NS

    def on_end(self, goal: bytes, status: int) -> Outcome | None:
        """Return the outcome of `goal` once, even if its end is reported repeatedly."""
        record = self._goals.get(goal)
        if record is None or record.state == "over":
            return None
        record.state = "over"
        if goal != self.wanted:
            return None
        self.wanted = None
        return OUTCOMES.get(status, "failed")

    def to_cancel(self, now_ns: int) -> list[bytes]:
        """Return the goals that are to be cancelled now: those that the server may work on unwanted.

        A server that has just accepted the wanted goal gets `GRACE_NS` to end the others by itself.
        """
        if self.wanted is not None:
            wanted = self._goals[self.wanted]
            if wanted.state == "sent" or now_ns - wanted.decided_ns < GRACE_NS:
                return []
        due: list[bytes] = []
        for goal, record in self._goals.items():
            if goal == self.wanted or record.state not in OPEN:
                continue
            if now_ns - record.cancelled_ns >= RETRY_NS:
                record.cancelled_ns = now_ns
                due.append(goal)
        return due

    def on_unknown(self, goal: bytes) -> None:
        """Stop cancelling `goal`, which the server does not know.

        It may receive the goal later, and report it.
        """
        record = self._goals.get(goal)
        if record is None or goal == self.wanted:
            return
        if record.state in {"silent", "accepted", "active"}:
            record.state = "unknown"

    @property
    def has_unwanted(self) -> bool:
        """Return True if the server may work on a goal that nobody wants."""
        for goal, record in self._goals.items():
            if goal != self.wanted and record.state in OPEN:
                return True
        return False

    def _on_active(self, goal: bytes, now_ns: int) -> Outcome | None:
        record = self._goals.get(goal)
        if record is None or record.state in {"active", "over"}:
            return None
        if record.state != "accepted":
            record.decided_ns = now_ns
        record.state = "active"
        return "active" if goal == self.wanted else None
