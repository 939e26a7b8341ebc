"""Whether a robot may be sent to a place: what it is on, how sure it is, who stands there."""

import math

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Environment, Interaction, UserPose
from pointit.services.goal.config import GoalConfig

LEVEL = math.cos(math.radians(5.0))
"""What a plane's normal has of the vertical, at least, where a robot can stand on it."""


class GoalChecker:
    """Knows the level surfaces, where people stand, whether one of them points; says what speaks against."""

    def __init__(self, config: GoalConfig, user: str) -> None:
        """Judge for `user`, with nothing known."""
        self._config = config
        self._user = user
        self._level: frozenset[str] = frozenset()
        self._poses: dict[str, UserPose] = {}
        self._interaction: Interaction | None = None

    @property
    def is_pointing(self) -> bool:
        """Return True if the person's supervisor says that they point."""
        return self._interaction is not None and self._interaction.state == "pointing"

    def on_map(self, environment: Environment) -> None:
        """Take the room: its level planes are what a goal can be on."""
        self._level = frozenset(
            plane.id
            for plane in environment.planes
            if abs(plane.normal[2]) >= LEVEL * math.hypot(*plane.normal)
        )

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Take where somebody stands; it holds till they say otherwise, even when nobody hears of them."""
        self._poses[user] = pose

    def on_interaction(self, interaction: Interaction) -> None:
        """Take what the person is about."""
        self._interaction = interaction

    def place(self, cursor: Cursor) -> Vec3 | None:
        """Return the point of `cursor` if it is on what a goal can be on; a plane must be seen from above."""
        point, eyes = cursor.point_m, cursor.origin_m
        if cursor.surface_id in self._config.surfaces:
            return point
        if cursor.solid != "plane" or cursor.surface_id not in self._level or point is None or eyes is None:
            return None
        return point if point[2] < eyes[2] else None

    def yaw_rad(self, place_m: Vec3) -> float:
        """Return the azimuth from the person to the place."""
        feet = self._poses[self._user].position_m
        return math.atan2(place_m[1] - feet[1], place_m[0] - feet[0])

    def clearance_m(self, place_m: Vec3) -> float:
        """Return how far the nearest person is whose place is known; nobody: infinitely far."""
        gaps = (math.dist(place_m[:2], pose.position_m[:2]) for pose in self._poses.values())
        return min(gaps, default=math.inf)

    def sigma_m(self, place_m: Vec3, cursor: Cursor) -> float:
        """Return 1 sigma of the place on the floor along its worse direction.

        The covariance of the person's place and yaw, carried over to where they point, and their aim: it
        spreads along the ray by 1/sin of its slope, across it by the range alone. Infinite where unknown.
        """
        pose = self._poses.get(self._user)
        if pose is None or cursor.origin_m is None:
            return math.inf
        over = np.array(place_m) - np.array(pose.position_m)
        turn = np.array([[1.0, 0.0, -over[1]], [0.0, 1.0, over[0]]])
        spread = turn @ np.array(pose.covariance).reshape(3, 3) @ turn.T
        reach = np.array(place_m) - np.array(cursor.origin_m)
        range_m, level_m = float(np.linalg.norm(reach)), float(np.hypot(reach[0], reach[1]))
        aim_m = math.radians(self._config.aim_sigma_deg) * range_m
        if aim_m > 0.0:
            if abs(reach[2]) < 1e-6 * range_m:
                return math.inf
            ahead = reach[:2] / level_m if level_m > 0.0 else np.array([1.0, 0.0])
            across = np.array([-ahead[1], ahead[0]])
            slope = abs(float(reach[2])) / range_m
            spread += (aim_m / slope) ** 2 * np.outer(ahead, ahead) + aim_m**2 * np.outer(across, across)
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh((spread + spread.T) / 2.0)[-1])))

    def rejection_reason(self, place_m: Vec3, cursor: Cursor, now_ns: int) -> str:
        """Return what speaks against sending a robot to a place, in one sentence; empty: nothing."""
        config = self._config
        if not self.is_pointing:
            return "you are not pointing: press your button first"
        age_s = (now_ns - cursor.stamp_ns) / NS_PER_S
        if age_s > config.max_age_s:
            return f"what is known of your arm is {age_s:.1f} s old: look for a slow link"
        if age_s < -config.max_age_s:
            return f"your arm is {-age_s:.1f} s ahead of this machine's clock: synchronize the two clocks"
        if self._user not in self._poses:
            return "nobody knows where you stand: localize first"
        if self._interaction is not None and self._interaction.is_unsure:
            return "your direction has become uncertain: press twice, then point at a lamp once"
        sigma_m = self.sigma_m(place_m, cursor)
        if not sigma_m <= config.max_sigma_m:
            how = f"sure to {sigma_m:.1f} m only" if math.isfinite(sigma_m) else "not known well enough"
            return f"the place is {how}: choose one nearer to you, or localize anew"
        for user, pose in self._poses.items():
            gap_m = math.dist(place_m[:2], pose.position_m[:2])
            if gap_m < config.keep_out_m:
                whom = "you" if user == self._user else user
                return f"the place is {gap_m:.1f} m from {whom}: choose one {config.keep_out_m:g} m away"
        return ""
