"""The people around a robot: where they are, and whether the one who steers it is sure and holds on."""

import math

from pointit.geometry.floor_sigma import place_sigma_m, position_sigma_m
from pointit.geometry.solids import is_level
from pointit.schemas import NS_PER_S, Cursor, Environment, Interaction, UserPose
from pointit.schemas.text import round_beyond
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.safety.region import CylinderObstacle
from pointit.services.robot.stop_reason import StopReason

LEVEL_WORKSPACE = "workspace/horizontal"
EXTERNAL_S = 2.0
"""Age of a pose from an external tracker, which comes all the time, at which it is stale."""
LINK = "the wrist's battery and link"
FORGOTTEN_S = 600.0
"""Time after which a person whose services have ended is no longer kept clear of."""


class PeopleNearRobot:
    """Poses, interactions, cursors and presence of everybody."""

    def __init__(self, config: RobotConfig, robot: str) -> None:
        self._config = config
        self._robot = robot
        self._level: frozenset[str] = frozenset()
        self._poses: dict[str, UserPose] = {}
        self._interactions: dict[str, Interaction] = {}
        self._pointing_since_ns: dict[str, int] = {}
        """Time since which each person points. There are no cursors while they are localized."""
        self._cursors: dict[str, Cursor] = {}
        self._pointed_cursors: dict[str, Cursor] = {}
        """The last cursor of each person that is on something."""
        self._gone_ns: dict[str, int | None] = {}
        """People whose services have ended, and when that was seen."""

    def on_map(self, environment: Environment) -> None:
        """Update the level planes."""
        level_planes = [plane for plane in environment.planes if is_level(plane.normal)]
        self._level = frozenset(plane.id for plane in level_planes)

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Update a person's pose."""
        self._poses[user] = pose

    def on_presence(self, user: str, *, is_present: bool) -> None:
        """Update a person's presence. The place of a person who is gone is kept for a while."""
        if is_present:
            self._gone_ns.pop(user, None)
            return
        self._gone_ns.setdefault(user, None)
        self._interactions.pop(user, None)
        self._cursors.pop(user, None)
        self._pointed_cursors.pop(user, None)

    def on_interaction(self, user: str, interaction: Interaction) -> None:
        """Update a person's interaction."""
        previous = self._interactions.get(user)
        has_pointed = previous is not None and previous.state == "pointing"
        if interaction.state == "pointing" and not has_pointed:
            self._pointing_since_ns[user] = interaction.stamp_ns
        self._interactions[user] = interaction

    def on_cursor(self, user: str, cursor: Cursor) -> None:
        """Update a person's cursor."""
        self._cursors[user] = cursor
        if cursor.point_m is not None:
            self._pointed_cursors[user] = cursor

    def cylinders(self, now_ns: int) -> tuple[CylinderObstacle, ...]:
        """Return the space of each person: `keep_out_m` and twice the sigma of their place around it."""
        # Those whose services have ended may still be there
        for user, gone_ns in tuple(self._gone_ns.items()):
            if gone_ns is None:
                self._gone_ns[user] = now_ns
            elif now_ns - gone_ns > FORGOTTEN_S * NS_PER_S:
                self._poses.pop(user, None)
        cylinders: list[CylinderObstacle] = []
        for user, pose in self._poses.items():
            radius_m = self._config.keep_out_m + 2.0 * position_sigma_m(pose.covariance)
            cylinders.append(CylinderObstacle("people", user, pose.position_m, radius_m))
        return tuple(cylinders)

    def room_remedy(self, name: str) -> str:
        """Return the remedy for too little room beside a person. Only a tracked position follows them."""
        pose = self._poses.get(name)
        if pose is None or pose.method == "external":
            return "make room"
        sigma_m = position_sigma_m(pose.covariance)
        position = "the known position"
        if sigma_m > 0.0:
            position = f"the known position (1 sigma {sigma_m:.2f} m)"
        return f"let {name} step back and localize again: {position} does not follow them"

    def stop_reason(self, user: str, now_ns: int) -> StopReason | None:
        """Return the reason not to do what `user` wants, whatever they point at, or None."""
        gone = self.presence_stop_reason(user)
        if gone is not None:
            return gone

        # While its user is localized, a ground robot waits. A quadrotor is released
        interaction = self._interactions.get(user)
        state = "" if interaction is None else interaction.state
        if state == "localizing" and self._config.kind == "ground":
            text = f"{self._robot} waits until {user} is localized"
            return StopReason("not_pointing", text, is_freeing=False)
        if interaction is None or state != "pointing":
            text = f"{user} is not pointing: press the button, then take {self._robot} again"
            return StopReason("not_pointing", text, is_freeing=True)

        # Where they point is known only with their position and direction
        pose = self._poses.get(user)
        if pose is None:
            return StopReason("pose", f"{user}'s position is unknown: localize first", is_freeing=True)
        age_s = (now_ns - pose.stamp_ns) / NS_PER_S
        if pose.method == "external" and age_s > EXTERNAL_S:
            old_s = round_beyond(age_s, EXTERNAL_S)
            text = f"{user}'s position is {old_s} s old: look at the tracker that gives it"
            return StopReason("pose", text, is_freeing=False)
        if interaction.is_unsure:
            text = f"{user}'s direction has become uncertain: press twice, then point at a lamp once"
            return StopReason("unsure", text, is_freeing=False)
        return None

    def presence_stop_reason(self, user: str) -> StopReason | None:
        """Return the reason to stop `user`'s present order, if their services have ended, or None."""
        if user not in self._gone_ns:
            return None
        text = f"{user}'s services have ended: {self._robot} waits until somebody takes it"
        return StopReason("gone", text, is_freeing=True)

    def cursor_stop_reason(self, user: str, now_ns: int, *, follows: bool) -> StopReason | None:
        """Return the reason why `user`'s pointing cannot move a robot now, or None.

        `follows`: the robot follows their cursor, which must be on a place that is sure; else it carries out
        a goal, when their arm must only report.
        """
        config = self._config
        timeout_s = config.cursor_timeout_s
        if not follows:
            timeout_s = max(config.cursor_timeout_s, config.report_timeout_s)

        # The newest cursor, which also says that the arm reports
        cursor = self._cursors.get(user)
        age_s = math.inf
        if cursor is not None:
            age_s = (now_ns - cursor.stamp_ns) / NS_PER_S
        if abs(age_s) > timeout_s:
            text = self._cursor_age_problem(user, age_s, timeout_s, now_ns)
            return StopReason("cursor", text, is_freeing=False)
        if not follows:
            return None

        # The newest one on something: for a moment they may point past everything
        pointed = self._pointed_cursors.get(user)
        if pointed is None or (now_ns - pointed.stamp_ns) / NS_PER_S > timeout_s:
            text = f"{user} points past everything: point at the place for {self._robot}"
            return StopReason("cursor", text, is_freeing=False)
        return self.sigma_stop_reason(self.sigma_m(user, pointed))

    def _cursor_age_problem(self, user: str, age_s: float, timeout_s: float, now_ns: int) -> str:
        """Return the problem and the remedy, as one sentence, if the newest cursor has not the right age."""
        pointing_s = (now_ns - self._pointing_since_ns.get(user, 0)) / NS_PER_S
        if age_s >= pointing_s:  # none came while they were localized, so that its age means nothing
            return f"{self._robot} waits for {user}'s first cursor; if none comes, look at {LINK}"
        if age_s < 0.0:
            ahead_s = round_beyond(-age_s, timeout_s)
            return f"{user}'s arm is {ahead_s} s ahead of this machine: synchronize the two clocks"
        old_s = round_beyond(age_s, timeout_s)
        return f"the last cursor of {user} is {old_s} s old: look at {LINK}"

    def sigma_stop_reason(self, sigma_m: float) -> StopReason | None:
        """Return the reason to refuse a place known to `sigma_m`, or None."""
        limit_m = self._config.max_cursor_sigma_m
        if sigma_m <= limit_m:
            return None
        certainty = "not known"
        if math.isfinite(sigma_m):
            certainty = f"sure to {round_beyond(sigma_m, limit_m)} m only, limit {limit_m:g} m"
        text = f"the pointed place is {certainty}: choose one nearer to you, or localize again"
        return StopReason("unsure", text, is_freeing=False)

    def sigma_m(self, user: str, cursor: Cursor) -> float:
        """Return 1 sigma of the place of `cursor` along its worse direction, infinite if unknown."""
        pose = self._poses.get(user)
        if pose is None:
            return math.inf
        if cursor.origin_m is None or cursor.point_m is None:
            return math.inf
        aim_rad = math.radians(self._config.aim_sigma_deg)
        is_level = self.is_on_level(cursor)
        return place_sigma_m(
            cursor.point_m, pose.position_m, pose.covariance, cursor.origin_m, aim_rad, is_level=is_level
        )

    def is_on_level(self, cursor: Cursor) -> bool:
        """Return True if `cursor` is on a level plane of the map, or on the one about the person."""
        is_on_plane = cursor.solid == "plane" and cursor.surface_id in self._level
        return is_on_plane or cursor.surface_id == LEVEL_WORKSPACE
