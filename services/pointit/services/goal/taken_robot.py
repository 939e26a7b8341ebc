"""A robot that a person has, or has asked for: what its reports mean for them."""

import math
from typing import Literal, NamedTuple

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Goal, RobotState
from pointit.schemas.cues import Cue

ANSWER_NS = 3 * NS_PER_S
"""Time within which a robot answers a request, or a goal."""
DECIDED_NS = NS_PER_S // 2
"""Time after a request from which a reason given by the robot is its answer."""
REPORTED_NS = 2 * NS_PER_S
"""Least time between two reasons that the person receives: numbers in them change."""
ARRIVED_M = 0.3
"""Distance from a goal within which a robot has arrived."""

HOW: dict[str, str] = {
    "quadrotor": "it takes off and follows where you point; press to land it there",
    "ground": "stay at places to set way-points, then press to send it",
}


class RobotCue(NamedTuple):
    """A cue for the person."""

    cue: Cue
    text: str
    ends: bool = False
    """True if the person has the robot no longer."""
    sign_of: Cue | None = None
    place_m: Vec3 | None = None


class TakenRobot:
    """Follows the states of one robot for one person."""

    def __init__(self, name: str, user: str, now_ns: int) -> None:
        """Start with the request of `user` for `name` at `now_ns`."""
        self.name = name
        self.is_owner = False
        """True once the robot has accepted the person."""
        self.checked_ns = now_ns
        self._user = user
        self._since_ns = now_ns
        self._reason = ""
        """Reason that was reported last."""
        self._reported_ns = 0
        self._goal: Goal | None = None
        """Goal that was sent and has no result yet."""
        self._sent_ns = 0
        self._is_going = False

    def on_goal(self, goal: Goal, now_ns: int) -> None:
        """Await the result of `goal`, which replaces the one before."""
        self._goal, self._sent_ns, self._is_going = goal, now_ns, False

    def on_state(
        self, state: RobotState, mode: Literal["none", "follow", "goals", "land"], now_ns: int
    ) -> RobotCue | None:
        """Return the cue for a state of the robot while the person wants `mode` of it, if there is any."""
        if not self.is_owner:
            return self._requested(state, now_ns)
        is_down = state.phase == "landed" and mode == "land"
        if is_down:
            return RobotCue("selected", f"{self.name} has landed", True, "localized", state.position_m)
        if state.user != self._user:
            why = (
                state.reason or "somebody stopped it, or you were not heard of; point at it and take it again"
            )
            return RobotCue("deselected", f"{self.name} is no longer yours: {why}", ends=True)
        if state.reason and state.reason != self._reason:
            if now_ns - self._reported_ns < REPORTED_NS:
                return None
            self._reason, self._reported_ns = state.reason, now_ns
            if state.phase != "moving":
                self._goal = None
            return RobotCue("refused", f"{self.name}: {state.reason}", place_m=state.target_m)
        self._reason = state.reason
        return self._arrival(state)

    def tick(self, now_ns: int, *, is_silent: bool) -> RobotCue | None:
        """Return the cue for a missing answer, if one is overdue."""
        if is_silent:
            text = f"{self.name} is lost: it reports nothing; see that its process runs"
            return RobotCue("deselected" if self.is_owner else "refused", text, ends=True)
        if not self.is_owner and now_ns - self._since_ns > ANSWER_NS:
            text = f"{self.name} does not answer: see that it runs, and take it again"
            return RobotCue("refused", text, ends=True)
        if self._goal is not None and not self._is_going and now_ns - self._sent_ns > ANSWER_NS:
            self._goal = None
            return RobotCue("refused", f"{self.name} has not taken the goal: set its way-points again")
        return None

    def _requested(self, state: RobotState, now_ns: int) -> RobotCue | None:
        if state.user == self._user:
            self.is_owner, self._reason = True, state.reason
            return RobotCue("selected", f"{self.name} is yours: {HOW[state.kind]}", place_m=state.position_m)
        if state.user:
            text = f"{self.name} is steered by {state.user}: wait until it is free, or point at another robot"
            return RobotCue("refused", text, ends=True)
        if state.reason and now_ns - self._since_ns > DECIDED_NS:
            return RobotCue("refused", f"{self.name}: {state.reason}", ends=True)
        return None

    def _arrival(self, state: RobotState) -> RobotCue | None:
        goal = self._goal
        if goal is None:
            return None
        if state.goal_ns == goal.stamp_ns:
            self._is_going = True
        is_over = self._is_going and (state.goal_ns != goal.stamp_ns or state.phase == "idle")
        if not is_over:
            return None
        away_m = math.dist(state.position_m[:2], goal.position_m[:2])
        self._goal = None
        if away_m <= ARRIVED_M:
            return RobotCue(
                "selected", f"{self.name} has arrived", sign_of="localized", place_m=state.position_m
            )
        return RobotCue("refused", f"{self.name} stopped {away_m:.1f} m before its goal: send it again")
