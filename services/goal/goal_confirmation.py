"""A goal in two steps: staying at a permitted place proposes it, and a confirmation makes it a goal.

After a stay with a result (a proposal, a refusal, a goal) the next stay begins only after the cursor has left
the place. All three gestures of the button are used by the interaction, so the second step is a second stay
by default, and a press only if the supervisor leaves presses to other services.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from pointit.geometry import vector
from pointit.geometry.floor_sigma import place_sigma_m
from pointit.geometry.solids import is_level
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.schemas import NS_PER_S, ButtonEvent, Cursor, Environment, Feedback, Goal, Interaction, UserPose
from pointit.schemas.selection import SIGNS, Cue
from pointit.schemas.text import round_beyond
from pointit.services.goal.config import GoalConfig


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


LEVEL_M = 0.3
"""Height above or below the person's floor up to which a requested place is on it, m."""
MAX_PRESS_S = 2.0
"""Longest press of a headset, s. It is stamped when the button goes down, and sent when it comes up."""


def is_late(event: ButtonEvent, now_ns: int, max_age_s: float) -> bool:
    """Return True if a press is older than `max_age_s`, or from the future by as much."""
    age_s = (now_ns - event.stamp_ns) / NS_PER_S
    return not -max_age_s <= age_s <= max_age_s + (MAX_PRESS_S if event.source == "headset" else 0.0)


class GoalChecker:
    """Checks places by the level surfaces, people's positions and the person's interaction."""

    def __init__(self, config: GoalConfig, user: str) -> None:
        self._config = config
        self._user = user
        self._level: frozenset[str] = frozenset()
        self._poses: dict[str, UserPose] = {}
        self._interaction: Interaction | None = None
        self.unsure_reason = ""
        """Advice to a person whose direction is uncertain, or `""`."""

    @property
    def is_pointing(self) -> bool:
        """Return True if the person's supervisor reports that they point."""
        return self._interaction is not None and self._interaction.state == "pointing"

    def on_map(self, environment: Environment) -> None:
        """Update the level planes of the map."""
        self._level = frozenset(plane.id for plane in environment.planes if is_level(plane.normal))

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Update a person's pose, which is valid until the next one even if they leave."""
        self._poses[user] = pose

    def on_interaction(self, interaction: Interaction) -> None:
        """Update the interaction state of the person."""
        self._interaction = interaction
        advice = "your direction has become uncertain: press twice, then point at a lamp once"
        self.unsure_reason = advice if interaction.is_unsure else ""

    def place(self, cursor: Cursor) -> Vec3 | None:
        """Return the point of `cursor` if a goal can be there, else None; a plane must be seen from above."""
        point, eyes = cursor.point_m, cursor.origin_m
        if cursor.surface_id in self._config.surfaces:
            return point
        if cursor.solid != "plane" or cursor.surface_id not in self._level or point is None or eyes is None:
            return None
        return point if point[2] < eyes[2] else None

    def goal(self, place_m: Vec3, cursor: Cursor, now_ns: int, **details: Any) -> Goal:
        """Return the goal at a place for which there is no `rejection_reason`, with `details`."""
        feet_m = self._poses[self._user].position_m
        return Goal(
            stamp_ns=cursor.stamp_ns,
            position_m=place_m,
            yaw_rad=math.atan2(place_m[1] - feet_m[1], place_m[0] - feet_m[0]),
            age_s=max(0, now_ns - cursor.stamp_ns) / NS_PER_S,
            position_sigma_m=self.sigma_m(place_m, cursor),
            clearance_m=min(math.dist(place_m[:2], pose.position_m[:2]) for pose in self._poses.values()),
            **details,
        )

    def sigma_m(self, place_m: Vec3, cursor: Cursor) -> float:
        """Return 1 sigma of the place on the floor along its worse direction, infinite if unknown."""
        pose = self._poses.get(self._user)
        if pose is None or cursor.origin_m is None:
            return math.inf
        aim_rad = math.radians(self._config.aim_sigma_deg)
        return place_sigma_m(place_m, pose.position_m, pose.covariance, cursor.origin_m, aim_rad)

    def rejection_reason(self, place_m: Vec3, cursor: Cursor, now_ns: int) -> str:
        """Return the reason not to send a robot to a place, or `""` if there is none."""
        config = self._config
        if not self.is_pointing:
            return "you are not pointing: press your button first"
        age_s = (now_ns - cursor.stamp_ns) / NS_PER_S
        if age_s > config.max_age_s:
            return f"the last data of your arm is {age_s:.1f} s old: look for a slow link"
        if age_s < -config.max_age_s:
            return f"your arm is {-age_s:.1f} s ahead of this machine's clock: synchronize the two clocks"
        if self._user not in self._poses:
            return "your position is unknown: localize first"
        if self.unsure_reason:
            return self.unsure_reason
        sigma_m = self.sigma_m(place_m, cursor)
        if not sigma_m <= config.max_sigma_m:
            how = (
                f"sure to {round_beyond(sigma_m, config.max_sigma_m)} m only"
                if math.isfinite(sigma_m)
                else "not known well enough"
            )
            return f"the place is {how}: choose one nearer to you, or localize again"
        for user, pose in self._poses.items():
            gap_m = math.dist(place_m[:2], pose.position_m[:2])
            if gap_m < config.keep_out_m:
                whom = "you" if user == self._user else user
                near_m, limit_m = round_beyond(gap_m, config.keep_out_m), config.keep_out_m
                return f"the place is {near_m} m from {whom}: choose one {limit_m:g} m away"
        return ""

    def request_problem(self, place_m: Vec3, cursor: Cursor | None, now_ns: int) -> str:
        """Return the reason not to send a robot to a place that was not pointed at twice, or `""`.

        A person who speaks has to point meanwhile, as for any other goal; the place is on their floor.
        """
        if cursor is None:
            return "nothing is known of your arm: point while you speak"
        if reason := self.rejection_reason(place_m, cursor, now_ns):
            return reason
        above_m = place_m[2] - self._poses[self._user].position_m[2]
        return (
            ""
            if abs(above_m) <= LEVEL_M
            else f"the place is {above_m:.1f} m above the floor: choose one on it"
        )


GAP_NS = 300_000_000
"""Time without cursors that ends a stay."""
BACK_NS = NS_PER_S
"""A cursor older than the one before by at most this is late. One older still is of a clock that was set."""

LEFT = 2.0
"""Distance at which a place is left, in radii."""


def cursor_order(before: Cursor | None, cursor: Cursor) -> Literal["late", "next", "gap"]:
    """Return the order of `cursor`: late, next after the one before, or next after a gap."""
    step_ns = 0 if before is None else cursor.stamp_ns - before.stamp_ns
    if -BACK_NS <= step_ns < 0:
        return "late"
    return "next" if 0 <= step_ns <= GAP_NS else "gap"


@dataclass
class _Stay:
    first_m: Vec3
    surface_id: str
    since_ns: int
    total_m: Vec3 = (0.0, 0.0, 0.0)
    count: int = 0

    @property
    def mean_m(self) -> Vec3:
        return vector.scale(self.total_m, 1.0 / self.count)


class StayDetector:
    """Reports each stay of a cursor within a radius once. The next begins after that place was left."""

    def __init__(self, radius_m: float, dwell_s: float) -> None:
        """Detect stays of `dwell_s` within `radius_m` of the first cursor."""
        self._radius_m = radius_m
        self._dwell_ns = round(dwell_s * NS_PER_S)
        self._stay: _Stay | None = None
        self._over: tuple[str, Vec3] | None = None
        """Surface and place of the last reported stay, until it is left."""

    def interrupt(self) -> None:
        """End the current stay, as cursors are missing."""
        self._stay = None

    def reset(self) -> None:
        """Forget the current stay and the last one, so that the next may be anywhere."""
        self._stay = self._over = None

    def bar(self, surface_id: str, place_m: Vec3) -> None:
        """Report no stay until the cursor has left `place_m`, {W}."""
        self._stay, self._over = None, (surface_id, place_m)

    def on_cursor(self, place_m: Vec3 | None, surface_id: str, stamp_ns: int) -> Vec3 | None:
        """Return the mean place, {W}, of the stay that this cursor completes, None if it completes none.

        Args:
            place_m: an allowed place, or None.
            surface_id: of the surface there.
            stamp_ns: of the cursor.
        """
        if self._over is not None and self.is_away(place_m, surface_id, *self._over):
            self.reset()
        if place_m is None:
            self._stay = None
        if place_m is None or self._over is not None:
            return None
        stay = self._stay
        if stay is None or stay.surface_id != surface_id or math.dist(stay.first_m, place_m) > self._radius_m:
            stay = self._stay = _Stay(place_m, surface_id, stamp_ns)
        stay.total_m = vector.add(stay.total_m, place_m)
        stay.count += 1
        if stamp_ns - stay.since_ns < self._dwell_ns:
            return None
        self.bar(surface_id, stay.mean_m)
        return stay.mean_m

    def is_away(self, here_m: Vec3 | None, here_id: str, surface_id: str, place_m: Vec3) -> bool:
        """Return True if `here_m` on surface `here_id` is no longer at `place_m` on `surface_id`."""
        is_on = here_m is not None and here_id == surface_id
        return not is_on or math.dist(here_m or place_m, place_m) > LEFT * self._radius_m


Output = Goal | Feedback

THERE = 1.5
"""Distance at which a second stay is still at the place of the first, in radii. People return without seeing
the cursor, and two reaches differ by some degrees (pointing.md §7)."""


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
        """Process a cursor; cursors out of order are ignored."""
        outputs = self.tick(now_ns)
        order = cursor_order(self._cursor, cursor)
        if order == "late":
            return outputs
        if order == "gap":
            self._stays.interrupt()
        self._cursor = cursor
        mean_m = self._stays.on_cursor(self._checker.place(cursor), cursor.surface_id, cursor.stamp_ns)
        return outputs if mean_m is None else [*outputs, *self._stayed(mean_m, cursor, now_ns)]

    def on_button(self, event: ButtonEvent, now_ns: int) -> list[Output]:
        """Process a gesture: a press confirms the proposal if so configured."""
        outputs = self.tick(now_ns)
        proposal = self._proposal
        is_confirmed = self._config.confirm == "press" and event.gesture == "press"
        if proposal is None or self._cursor is None or not is_confirmed or event.stamp_ns < proposal.stamp_ns:
            return outputs
        if is_late(event, now_ns, self._config.max_age_s):
            late = "your press came late, or by another clock: point there and press once more"
            return [*outputs, *self._refuse(late, now_ns)]
        here = self._checker.place(self._cursor)
        if self._stays.is_away(here, self._cursor.surface_id, proposal.surface_id, proposal.place_m):
            return [*outputs, *self._refuse("you pointed elsewhere: point at the place as you press", now_ns)]
        return [*outputs, *self._confirm(proposal, self._cursor, "press", now_ns)]

    def send(self, robot: str, place_m: Vec3, now_ns: int) -> list[Output]:
        """Send a robot to a place at once, as a person asks, with all checks; it counts as confirmed.

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
        """Advance to `now_ns`; an unconfirmed proposal is withdrawn in time."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return []
        return self._withdraw(f"not confirmed within {self._config.confirm_s:g} s", now_ns)

    def _stayed(self, mean_m: Vec3, cursor: Cursor, now_ns: int) -> list[Output]:
        proposal = self._proposal
        if (
            self._config.confirm == "again"
            and proposal is not None
            and proposal.surface_id == cursor.surface_id
            and math.dist(proposal.place_m, mean_m) <= THERE * self._config.radius_m
        ):
            self._stays.bar(proposal.surface_id, proposal.place_m)
            return self._confirm(proposal, cursor, "again", now_ns)
        return self._propose(mean_m, cursor, now_ns)

    def _propose(self, place_m: Vec3, cursor: Cursor, now_ns: int) -> list[Output]:
        reason = self._checker.rejection_reason(place_m, cursor, now_ns)
        if reason:
            return self._refuse(reason, now_ns, place_m)
        self._proposal = _Proposal(place_m, cursor.surface_id, cursor.stamp_ns, now_ns)
        how = "point elsewhere, then there again" if self._config.confirm == "again" else "press your button"
        text = f"send a robot there? {how} within {self._config.confirm_s:g} s"
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
        proposal, self._proposal = self._proposal, None
        if place_m is None and proposal is not None:
            place_m = proposal.place_m
        return [self._cues.make("refused", reason, now_ns, place_m)]

    def _withdraw(self, reason: str, now_ns: int) -> list[Output]:
        proposal, self._proposal = self._proposal, None
        if proposal is None:
            return []
        text = f"no robot is sent: {reason}"
        return [self._cues.make("deselected", text, now_ns, proposal.place_m)]
