"""Check of a goal's place by the level surfaces, people's positions and the person's interaction."""

import math
from typing import Any

from pointit.geometry import vector
from pointit.geometry.floor_sigma import place_sigma_m
from pointit.geometry.solids import is_level
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Environment, Goal, Interaction, UserPose
from pointit.schemas.text import round_beyond
from pointit.services.goal.config import GoalConfig

LEVEL_M = 0.3
"""Height above or below the person's floor up to which a requested place is on it, m."""


def floor_distance_m(a: Vec3, b: Vec3) -> float:
    """Return the distance between two places on the floor, m."""
    return math.dist(a[:2], b[:2])


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
        level_planes = [plane for plane in environment.planes if is_level(plane.normal)]
        self._level = frozenset(plane.id for plane in level_planes)

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Update a person's pose, which is valid until the next one even if they leave."""
        self._poses[user] = pose

    def on_interaction(self, interaction: Interaction) -> None:
        """Update the interaction state of the person."""
        self._interaction = interaction
        advice = "your direction has become uncertain: press twice, then point at a lamp once"
        self.unsure_reason = advice if interaction.is_unsure else ""

    def place(self, cursor: Cursor) -> Vec3 | None:
        """Return the point of `cursor` if a goal can be there, else None. A plane must be seen from above."""
        point = cursor.point_m
        eyes = cursor.origin_m
        if cursor.surface_id in self._config.surfaces:
            return point
        if cursor.solid != "plane" or cursor.surface_id not in self._level:
            return None
        if point is None or eyes is None:
            return None
        return point if point[2] < eyes[2] else None

    def goal(self, place_m: Vec3, cursor: Cursor, now_ns: int, **details: Any) -> Goal:
        """Return the goal at a place for which there is no `rejection_reason`, with `details`."""
        feet_m = self._poses[self._user].position_m
        from_feet = vector.subtract(place_m, feet_m)
        positions_m = [pose.position_m for pose in self._poses.values()]
        clearance_m = min(floor_distance_m(place_m, position_m) for position_m in positions_m)
        return Goal(
            stamp_ns=cursor.stamp_ns,
            position_m=place_m,
            yaw_rad=vector.azimuth(from_feet),
            age_s=max(0, now_ns - cursor.stamp_ns) / NS_PER_S,
            position_sigma_m=self.sigma_m(place_m, cursor),
            clearance_m=clearance_m,
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

        # The cursor is recent
        age_s = (now_ns - cursor.stamp_ns) / NS_PER_S
        if age_s > config.max_age_s:
            return f"the last data of your arm is {age_s:.1f} s old: look for a slow link"
        if age_s < -config.max_age_s:
            return f"your arm is {-age_s:.1f} s ahead of this machine's clock: synchronize the two clocks"

        # The place is known well enough. The negation refuses NaN, too
        if self._user not in self._poses:
            return "your position is unknown: localize first"
        if self.unsure_reason:
            return self.unsure_reason
        sigma_m = self.sigma_m(place_m, cursor)
        if not sigma_m <= config.max_sigma_m:
            certainty = "not known well enough"
            if math.isfinite(sigma_m):
                certainty = f"sure to {round_beyond(sigma_m, config.max_sigma_m)} m only"
            return f"the place is {certainty}: choose one nearer to you, or localize again"

        # Nobody is near it
        for user, pose in self._poses.items():
            gap_m = floor_distance_m(place_m, pose.position_m)
            if gap_m < config.keep_out_m:
                name = "you" if user == self._user else user
                rounded_m = round_beyond(gap_m, config.keep_out_m)
                limit_m = config.keep_out_m
                return f"the place is {rounded_m} m from {name}: choose one {limit_m:g} m away"
        return ""

    def request_problem(self, place_m: Vec3, cursor: Cursor | None, now_ns: int) -> str:
        """Return the reason not to send a robot to a place that was not pointed at twice, or `""`.

        A person who speaks has to point meanwhile, as for any other goal. The place is on their floor.
        """
        if cursor is None:
            return "nothing is known of your arm: point while you speak"
        reason = self.rejection_reason(place_m, cursor, now_ns)
        if reason:
            return reason
        height_m = place_m[2] - self._poses[self._user].position_m[2]
        if abs(height_m) <= LEVEL_M:
            return ""
        return f"the place is {height_m:.1f} m above the floor: choose one on it"
