"""A goal in two steps: staying at a place proposes it, and a confirmation makes it a goal.

After a stay with a result (a proposal, a refusal, a goal) the next stay begins only after the cursor has left
the place. All three gestures of the button are used by the interaction, so the second step is a second stay
by default, and a press only if the supervisor leaves presses to other services.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, ButtonEvent, Cursor, Environment, Feedback, Goal, Interaction, UserPose
from pointit.schemas.cues import SIGNS, Cue
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.goal_checks import GoalChecker

Output = Goal | Feedback

GAP_NS = 300_000_000
"""Time without cursors that ends a stay."""
LEFT, THERE = 2.0, 1.5
"""In radii: distance at which a place is left, and at which a second stay is still there. People return
without seeing the cursor, and two reaches differ by some degrees (pointing.md §7)."""
BACK_NS = NS_PER_S
"""A cursor older than the one before by at most this is late. One older still is of a clock that was set."""


class _Proposal(NamedTuple):
    place_m: Vec3
    surface_id: str
    stamp_ns: int
    """Stamp of the cursor."""
    since_ns: int
    """Time of the proposal."""


@dataclass
class _Stay:
    """Consecutive cursors at one place."""

    first_m: Vec3
    surface_id: str
    since_ns: int
    total_m: Vec3 = (0.0, 0.0, 0.0)
    count: int = 0

    @property
    def mean_m(self) -> Vec3:
        return vector.scale(self.total_m, 1.0 / self.count)


class GoalConfirmation:
    """Turns the pointing of one person into cues and goals."""

    def __init__(self, config: GoalConfig, user: str) -> None:
        """Start for `user` without any data or proposal."""
        self._config = config
        self._checker = GoalChecker(config, user)
        self._cursor: Cursor | None = None
        self._stay: _Stay | None = None
        self._over: tuple[str, Vec3] | None = None
        """Surface and place of the last stay with a result, until it is left."""
        self._proposal: _Proposal | None = None
        self._cues = self._goals = 0

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
        self._stay = self._over = None
        return self._withdraw("you stopped pointing", now_ns)

    def on_cursor(self, cursor: Cursor, now_ns: int) -> list[Output]:
        """Process a cursor; cursors out of order are ignored."""
        outputs = self.tick(now_ns)
        before = self._cursor
        if before is not None:
            step_ns = cursor.stamp_ns - before.stamp_ns
            if -BACK_NS <= step_ns < 0:
                return outputs
            if not 0 <= step_ns <= GAP_NS:
                self._stay = None
        self._cursor = cursor
        place = self._checker.place(cursor)
        if self._over is not None and self._is_away(place, cursor.surface_id, *self._over):
            self._over = self._stay = None
        if place is None:
            self._stay = None
        elif self._over is None:
            outputs += self._follow(place, cursor, now_ns)
        return outputs

    def on_button(self, event: ButtonEvent, now_ns: int) -> list[Output]:
        """Process a gesture: a press confirms the proposal if so configured."""
        outputs = self.tick(now_ns)
        proposal = self._proposal
        is_meant = self._config.confirm == "press" and event.gesture == "press"
        if proposal is None or self._cursor is None or not is_meant or event.stamp_ns < proposal.stamp_ns:
            return outputs
        if abs(now_ns - event.stamp_ns) > round(self._config.max_age_s * NS_PER_S):
            late = "your press came late, or by another clock: point there and press once more"
            return [*outputs, *self._refuse(late, now_ns)]
        here = self._checker.place(self._cursor)
        if self._is_away(here, self._cursor.surface_id, proposal.surface_id, proposal.place_m):
            return [*outputs, *self._refuse("you pointed elsewhere: point at the place as you press", now_ns)]
        return [*outputs, *self._confirm(proposal, self._cursor, "press", now_ns)]

    def tick(self, now_ns: int) -> list[Output]:
        """Advance to `now_ns`; an unconfirmed proposal is withdrawn in time."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return []
        return self._withdraw(f"not confirmed within {self._config.confirm_s:g} s", now_ns)

    def _follow(self, place: Vec3, cursor: Cursor, now_ns: int) -> list[Output]:
        """Continue the stay, or start one. Return the result when it is long enough."""
        stay = self._stay
        if (
            stay is None
            or stay.surface_id != cursor.surface_id
            or math.dist(stay.first_m, place) > self._config.radius_m
        ):
            stay = self._stay = _Stay(place, cursor.surface_id, cursor.stamp_ns)
        stay.total_m = vector.add(stay.total_m, place)
        stay.count += 1
        if cursor.stamp_ns - stay.since_ns < round(self._config.dwell_s * NS_PER_S):
            return []
        mean_m = stay.mean_m
        self._stay = None
        proposal = self._proposal
        if (
            self._config.confirm == "again"
            and proposal is not None
            and proposal.surface_id == cursor.surface_id
            and math.dist(proposal.place_m, mean_m) <= THERE * self._config.radius_m
        ):
            self._over = (proposal.surface_id, proposal.place_m)
            return self._confirm(proposal, cursor, "again", now_ns)
        self._over = (cursor.surface_id, mean_m)
        return self._propose(mean_m, cursor, now_ns)

    def _propose(self, place_m: Vec3, cursor: Cursor, now_ns: int) -> list[Output]:
        reason = self._checker.rejection_reason(place_m, cursor, now_ns)
        if reason:
            return self._refuse(reason, now_ns, place_m)
        self._proposal = _Proposal(place_m, cursor.surface_id, cursor.stamp_ns, now_ns)
        how = "point elsewhere, then there again" if self._config.confirm == "again" else "press your button"
        text = f"send a robot there? {how} within {self._config.confirm_s:g} s"
        return [self._cue("selected", "selected", text, now_ns, place_m)]

    def _confirm(
        self, proposal: _Proposal, cursor: Cursor, by: Literal["again", "press"], now_ns: int
    ) -> list[Output]:
        place_m = proposal.place_m
        reason = self._checker.rejection_reason(place_m, cursor, now_ns)
        if reason:
            return self._refuse(reason, now_ns, place_m)
        self._proposal = None
        self._goals += 1
        goal = Goal(
            stamp_ns=cursor.stamp_ns,
            seq=self._goals,
            position_m=place_m,
            yaw_rad=self._checker.yaw_rad(place_m),
            surface_id=proposal.surface_id,
            age_s=max(0, now_ns - cursor.stamp_ns) / NS_PER_S,
            position_sigma_m=self._checker.sigma_m(place_m, cursor),
            clearance_m=self._checker.clearance_m(place_m),
            proposed_ns=proposal.stamp_ns,
            confirmed_by=by,
        )
        return [goal, self._cue("selected", "localized", "the robot is sent there", now_ns, place_m)]

    def _refuse(self, reason: str, now_ns: int, place_m: Vec3 | None = None) -> list[Output]:
        proposal, self._proposal = self._proposal, None
        if place_m is None and proposal is not None:
            place_m = proposal.place_m
        return [self._cue("refused", "refused", reason, now_ns, place_m)]

    def _withdraw(self, reason: str, now_ns: int) -> list[Output]:
        proposal, self._proposal = self._proposal, None
        if proposal is None:
            return []
        text = f"no robot is sent: {reason}"
        return [self._cue("deselected", "deselected", text, now_ns, proposal.place_m)]

    def _is_away(self, here: Vec3 | None, surface_id: str, other_id: str, place_m: Vec3) -> bool:
        is_on = here is not None and surface_id == other_id
        return not is_on or math.dist(here or place_m, place_m) > LEFT * self._config.radius_m

    def _cue(self, cue: Cue, sign_of: Cue, text: str, now_ns: int, place_m: Vec3 | None) -> Feedback:
        """Return a cue with the signs of the table; goals and proposals sound differently."""
        sign = SIGNS[sign_of]
        self._cues += 1
        return Feedback(
            stamp_ns=now_ns,
            seq=self._cues,
            cue=cue,
            text=text,
            chime=sign.chime,
            haptic_ms=sign.haptic_ms,
            color=sign.color,
            point_m=place_m,
        )
