"""A goal in two steps: staying at a permitted place proposes it, and a confirmation makes it a goal.

After a stay with a result (a proposal, a refusal, a goal) the next stay begins only after the cursor has left
the place. All three gestures of the button are used by the interaction, so the second step is a second stay
by default, and a press only if the supervisor leaves presses to other services.
"""

import math
from typing import Literal, NamedTuple

from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas import NS_PER_S, ButtonEvent, Cursor, Environment, Feedback, Goal, Interaction, UserPose
from pointit.schemas.cues import SIGNS, Cue
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.goal_checker import GoalChecker
from pointit.services.goal.stay_detector import StayDetector, cursor_order

Output = Goal | Feedback

MAX_PRESS_S = 2.0
"""Longest press of a headset, s. It is stamped when the button goes down, and sent when it comes up."""
THERE = 1.5
"""Distance at which a second stay is still at the place of the first, in radii. People return without seeing
the cursor, and two reaches differ by some degrees (pointing.md §7)."""


class CueFactory:
    """Makes the cues of one publisher."""

    def __init__(self) -> None:
        self._count = 0

    def make(
        self, cue: Cue, text: str, now_ns: int, place_m: Vec3 | None = None, *, sign_of: Cue | None = None
    ) -> Feedback:
        """Return the message of a cue. It looks, sounds and feels like `sign_of`, by default like `cue`.

        `place_m` is the position in {W} that the cue concerns.
        """
        self._count += 1
        sign = SIGNS[sign_of or cue]._asdict()
        return Feedback(stamp_ns=now_ns, seq=self._count, cue=cue, text=text, point_m=place_m, **sign)


def is_late(event: ButtonEvent, now_ns: int, max_age_s: float) -> bool:
    """Return True if a press is older than `max_age_s`, or from the future by as much."""
    age_s = (now_ns - event.stamp_ns) / NS_PER_S
    oldest_s = max_age_s
    if event.source == "headset":
        oldest_s += MAX_PRESS_S
    return not -max_age_s <= age_s <= oldest_s


class _Proposal(NamedTuple):
    place_m: Vec3
    surface_id: str
    stamp_ns: int
    """Stamp of the cursor."""
    since_ns: int
    """Time of the proposal."""


class GoalConfirmation:
    """Turns the pointing of one person into cues and goals."""

    def __init__(self, config: GoalConfig, user: str) -> None:
        self._config = config
        self._checker = GoalChecker(config, user)
        self._cursor: Cursor | None = None
        self._stays = StayDetector(config.radius_m, config.dwell_s)
        self._proposal: _Proposal | None = None
        self._cues = CueFactory()
        self._goals = 0

    @property
    def deadline_ns(self) -> int | None:
        """Return the latest time for the next `tick`, or None if nothing is proposed."""
        if self._proposal is None:
            return None
        return self._proposal.since_ns + round(self._config.confirm_s * NS_PER_S)

    def on_map(self, environment: Environment) -> None:
        """Update the map."""
        self._checker.on_map(environment)

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Update the pose of `user`, who may be any person."""
        self._checker.on_pose(user, pose)

    def on_interaction(self, interaction: Interaction, now_ns: int) -> list[Output]:
        """Update the person's interaction. The end of pointing withdraws the proposal."""
        self._checker.on_interaction(interaction)
        if self._checker.is_pointing:
            return []
        self._stays.reset()
        return self._withdraw("you stopped pointing", now_ns)

    def on_cursor(self, cursor: Cursor, now_ns: int) -> list[Output]:
        """Process a cursor. Cursors out of order are ignored."""
        outputs = self.tick(now_ns)
        order = cursor_order(self._cursor, cursor)
        if order == "late":
            return outputs
        if order == "gap":
            self._stays.interrupt()
        self._cursor = cursor
        place_m = self._checker.place(cursor)
        mean_m = self._stays.on_cursor(place_m, cursor.surface_id, cursor.stamp_ns)
        if mean_m is None:
            return outputs
        return [*outputs, *self._on_stay(mean_m, cursor, now_ns)]

    def on_button(self, event: ButtonEvent, now_ns: int) -> list[Output]:
        """Process a gesture: a press confirms the proposal if so configured."""
        outputs = self.tick(now_ns)
        is_confirmation = self._config.confirm == "press" and event.gesture == "press"
        proposal = self._proposal
        cursor = self._cursor
        if not is_confirmation or proposal is None or cursor is None:
            return outputs
        if event.stamp_ns < proposal.stamp_ns:
            return outputs

        # A press confirms the proposal only in time, and while the person points at it
        if is_late(event, now_ns, self._config.max_age_s):
            late = "your press came late, or by another clock: point there and press once more"
            return [*outputs, *self._refuse(late, now_ns)]
        pointed_m = self._checker.place(cursor)
        if self._stays.is_away(pointed_m, cursor.surface_id, proposal.surface_id, proposal.place_m):
            elsewhere = "you pointed elsewhere: point at the place as you press"
            return [*outputs, *self._refuse(elsewhere, now_ns)]
        return [*outputs, *self._confirm(proposal, cursor, "press", now_ns)]

    def send(self, robot: str, place_m: Vec3, now_ns: int) -> list[Output]:
        """Send a robot to a place at once, as a person asks, with all checks. It counts as confirmed.

        Raises:
            RefusedError: If a check fails. Gives the reason.
        """
        if robot:
            raise RefusedError(f"{robot} cannot be chosen here: any robot takes goals (goal.steer)")
        cursor = self._cursor
        reason = self._checker.request_problem(place_m, cursor, now_ns)
        if reason or cursor is None:
            raise RefusedError(reason)
        proposal = _Proposal(place_m, "", cursor.stamp_ns, now_ns)
        return self._confirm(proposal, cursor, "press", now_ns)

    def tick(self, now_ns: int) -> list[Output]:
        """Advance to `now_ns`. An unconfirmed proposal is withdrawn in time."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return []
        return self._withdraw(f"not confirmed within {self._config.confirm_s:g} s", now_ns)

    def _on_stay(self, mean_m: Vec3, cursor: Cursor, now_ns: int) -> list[Output]:
        """Process a completed stay: a second one at the proposed place confirms it, any other proposes."""
        proposal = self._proposal
        if proposal is None or not self._is_confirmed_by_stay(proposal, mean_m, cursor.surface_id):
            return self._propose(mean_m, cursor, now_ns)
        self._stays.bar(proposal.surface_id, proposal.place_m)
        return self._confirm(proposal, cursor, "again", now_ns)

    def _is_confirmed_by_stay(self, proposal: _Proposal, mean_m: Vec3, surface_id: str) -> bool:
        """Return True if a stay is at the proposed place, and that confirms it."""
        if self._config.confirm != "again" or proposal.surface_id != surface_id:
            return False
        return math.dist(proposal.place_m, mean_m) <= THERE * self._config.radius_m

    def _propose(self, place_m: Vec3, cursor: Cursor, now_ns: int) -> list[Output]:
        reason = self._checker.rejection_reason(place_m, cursor, now_ns)
        if reason:
            return self._refuse(reason, now_ns, place_m)
        self._proposal = _Proposal(place_m, cursor.surface_id, cursor.stamp_ns, now_ns)
        instruction = "press your button"
        if self._config.confirm == "again":
            instruction = "point elsewhere, then there again"
        text = f"send a robot there? {instruction} within {self._config.confirm_s:g} s"
        return [self._cues.make("selected", text, now_ns, place_m)]

    def _confirm(
        self, proposal: _Proposal, cursor: Cursor, by: Literal["again", "press"], now_ns: int
    ) -> list[Output]:
        place_m = proposal.place_m
        reason = self._checker.rejection_reason(place_m, cursor, now_ns)
        if reason:
            return self._refuse(reason, now_ns, place_m)
        self._proposal = None
        self._goals += 1
        goal = self._checker.goal(
            place_m,
            cursor,
            now_ns,
            seq=self._goals,
            surface_id=proposal.surface_id,
            proposed_ns=proposal.stamp_ns,
            confirmed_by=by,
        )
        sent = self._cues.make("selected", "the robot is sent there", now_ns, place_m, sign_of="localized")
        return [goal, sent]

    def _refuse(self, reason: str, now_ns: int, place_m: Vec3 | None = None) -> list[Output]:
        proposal = self._proposal
        self._proposal = None
        if place_m is None and proposal is not None:
            place_m = proposal.place_m
        return [self._cues.make("refused", reason, now_ns, place_m)]

    def _withdraw(self, reason: str, now_ns: int) -> list[Output]:
        proposal = self._proposal
        self._proposal = None
        if proposal is None:
            return []
        text = f"no robot is sent: {reason}"
        return [self._cues.make("deselected", text, now_ns, proposal.place_m)]
