"""Places of cursors and goals as places for a robot."""

from pointit.geometry.plane import is_level
from pointit.geometry.vector import Vec3
from pointit.schemas import Cursor, Environment
from pointit.services.robot.config import RobotConfig

WORKSPACE = "workspace/"
"""Beginning of the ids of surfaces about a person."""
LEVEL_WORKSPACE = "workspace/horizontal"
MAX_STEP_M = 0.3
"""Height over or under a ground robot up to which a place is on its floor: ramps are, tables are not, m."""


class Targets:
    """Converts pointed places: a quadrotor hovers above level ones, a ground robot uses no others."""

    def __init__(self, config: RobotConfig) -> None:
        """Start without a map."""
        self._is_flying_kind = config.kind == "quadrotor"
        self._height_m = config.hover_m if self._is_flying_kind else 0.0
        self._level: frozenset[str] = frozenset()

    def on_map(self, environment: Environment) -> None:
        """Update the level planes."""
        self._level = frozenset(plane.id for plane in environment.planes if is_level(plane.normal))

    def of_cursor(self, cursor: Cursor, here_m: Vec3) -> Vec3 | None:
        """Return where the robot, now at `here_m`, is to go, or None if it cannot go where `cursor` is."""
        point, where = cursor.point_m, cursor.surface_id
        if point is None or not self.is_reachable(point, here_m):
            return None
        if where == LEVEL_WORKSPACE:
            return self.above(point, here_m)
        if where.startswith(WORKSPACE):
            return point if self._is_flying_kind else None
        if cursor.solid != "plane" or where not in self._level:
            return None
        is_from_above = cursor.origin_m is None or point[2] < cursor.origin_m[2]
        return self.above(point, here_m) if is_from_above else None

    def is_reachable(self, point_m: Vec3, here_m: Vec3) -> bool:
        """Return True unless a ground robot at `here_m` cannot get up or down to `point_m`."""
        return self._is_flying_kind or abs(point_m[2] - here_m[2]) <= MAX_STEP_M

    def above(self, point_m: Vec3, here_m: Vec3) -> Vec3:
        """Return where the robot is to be for a place on the ground. A ground robot stays at its height."""
        return (point_m[0], point_m[1], point_m[2] + self._height_m if self._is_flying_kind else here_m[2])
