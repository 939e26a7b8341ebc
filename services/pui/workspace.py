"""A surface around a person on which their cursor moves, to steer robots (pointing.md §5)."""

import math
from dataclasses import dataclass
from typing import Literal

from pointit.geometry import vector
from pointit.geometry.polyline import Hit, make_hit
from pointit.geometry.solids import GRAZING_RAD, PlaneSolid, SphereSolid
from pointit.geometry.vector import Vec3
from pointit.schemas.pointing import Solid

WorkspaceKind = Literal["horizontal", "facing", "cylinder", "sphere"]

SOLIDS: dict[WorkspaceKind, Solid] = {
    "horizontal": "plane",
    "facing": "plane",
    "cylinder": "cylinder",
    "sphere": "sphere",
}

NEAREST_M = 0.1
"""Minimum distance of a surface from the eyes, or from the person's axis."""

FARTHEST_M = 200.0
"""Maximum distance of a surface. A degree is metres there."""

START_M = 2.0
"""Distance from the person of a workspace, but a horizontal one, that is created when they start to point."""

SAME_M = 1e-6
"""Tolerance per metre of range by which the cursor may move when a workspace is created through it."""

STEEPEST_RAD = math.pi / 2.0


class WorkspaceError(ValueError):
    """A workspace cannot be created. The message is one sentence for the person."""


class Workspace:
    """A horizontal plane, an upright plane facing the person, a cylinder about their axis, or a sphere.

    Planes stay in place. The cylinder's axis and the sphere's centre follow the person and their eyes, with
    constant radius. Positions on it (`uv_m`): planes as `PlaneSolid` from the anchor, the sphere as
    `SphereSolid`, the cylinder (radius · azimuth, height above the person's feet).
    """

    def __init__(self, kind: WorkspaceKind, through_m: Vec3, *, feet_m: Vec3, eyes_m: Vec3) -> None:
        """Create through an anchor; places are in {W}, and `eyes_m` is the origin of the ray.

        Raises:
            WorkspaceError: If it would pass through the eyes, or too far away.
        """
        self.kind: WorkspaceKind = kind
        self.solid: Solid = SOLIDS[kind]
        self._steering_rad = (0.0, 0.0)
        self._plane: PlaneSolid | None = None
        from_eyes = vector.subtract(through_m, eyes_m)
        from_axis = vector.subtract(through_m, feet_m)

        # distance of the surface from the eyes, or from the person's axis
        if kind == "sphere":
            self._radius_m = vector.norm(from_eyes)
        elif kind == "horizontal":
            self._radius_m = abs(from_eyes[2])
        elif kind == "facing":
            self._radius_m = math.hypot(from_eyes[0], from_eyes[1])
        else:
            self._radius_m = math.hypot(from_axis[0], from_axis[1])
        if self._radius_m < NEAREST_M:
            raise WorkspaceError(
                f"a {kind} workspace through there would pass within {NEAREST_M:g} m of the person's eyes: "
                "choose another anchor or kind"
            )
        if vector.norm(from_eyes) > FARTHEST_M:
            raise WorkspaceError(f"a workspace more than {FARTHEST_M:g} m away cannot be pointed at")

        if kind == "horizontal":
            self._plane = PlaneSolid(through_m, (0.0, 0.0, 1.0))
        elif kind == "facing":
            level: Vec3 = (from_eyes[0], from_eyes[1], 0.0)
            to_person = vector.normalized(vector.scale(level, -1.0))
            self._plane = PlaneSolid(through_m, to_person)

    def steer(self, direction: Vec3, eyes_m: Vec3, feet_m: Vec3, point_m: Vec3) -> None:
        """Make the ray along `direction` meet it at `point_m`, and turn all later ones by the same angles.

        A cursor that was snapped to a thing stays in place when it moves from that thing to the workspace.

        Raises:
            WorkspaceError: If the workspace is too nearly parallel in that direction.
        """
        reach = vector.subtract(point_m, eyes_m)
        self._steering_rad = (
            vector.wrap(vector.azimuth(reach) - vector.azimuth(direction)),
            vector.elevation(reach) - vector.elevation(direction),
        )
        hit = self.intersect(eyes_m, direction, feet_m)
        if hit is None or math.dist(hit.point_m, point_m) > SAME_M * max(1.0, hit.range_m):
            raise WorkspaceError(
                f"the ray is too near parallel to a {self.kind} workspace: point elsewhere, or choose another"
            )

    def intersect(self, eyes_m: Vec3, direction: Vec3, feet_m: Vec3) -> Hit | None:
        """Return the hit of the ray from the eyes, with misses to the unsteered ray, or None."""
        steered = self._steered(vector.normalized(direction))
        if self._plane is not None:
            ahead = self._plane.intersect(eyes_m, steered)
            uv_at = self._plane.uv_at
        elif self.kind == "sphere":
            ahead = self._radius_m
            uv_at = SphereSolid(eyes_m, self._radius_m).uv_at
        else:
            ahead = self._leaves_cylinder(vector.subtract(eyes_m, feet_m), steered)
            uv_at = None
        if ahead is None or ahead > FARTHEST_M:
            return None
        point = vector.add(eyes_m, vector.scale(steered, ahead))
        if uv_at is None:
            own = vector.subtract(point, feet_m)
            uv = (self._radius_m * vector.azimuth(own), own[2])
        else:
            uv = uv_at(point)
        return make_hit(0, 0.0, point, eyes_m, direction)._replace(uv_m=uv)

    def _steered(self, direction: Vec3) -> Vec3:
        across, up = self._steering_rad
        if across == up == 0.0:
            return direction
        elevation = min(max(vector.elevation(direction) + up, -STEEPEST_RAD), STEEPEST_RAD)
        return vector.direction(vector.azimuth(direction) + across, elevation)

    def _leaves_cylinder(self, own: Vec3, d: Vec3) -> float | None:
        """Return the distance at which a ray from `own`, relative to the feet, leaves the cylinder."""
        square = d[0] * d[0] + d[1] * d[1]
        if square < 1e-12:
            return None
        towards = own[0] * d[0] + own[1] * d[1]
        gap = own[0] * own[0] + own[1] * own[1] - self._radius_m**2
        root = towards * towards - square * gap
        if root < 0.0:
            return None
        ahead = (math.sqrt(root) - towards) / square
        if ahead <= 0.0:
            return None

        # a ray that grazes the surface has no exact place on it
        x = own[0] + ahead * d[0]
        y = own[1] + ahead * d[1]
        cosine = (d[0] * x + d[1] * y) / self._radius_m
        return ahead if cosine > math.sin(GRAZING_RAD) else None


@dataclass(frozen=True, kw_only=True)
class WorkspaceStart:
    """Kind and position of the workspace relative to a person who starts to point."""

    kind: WorkspaceKind | None = None
    """Kind of the workspace. None: the map."""
    height_m: float = 0.0
    """Height of the horizontal plane above the person's feet."""

    def create(self, eyes_m: Vec3, direction: Vec3, feet_m: Vec3) -> Workspace | None:
        """Return it for a ray from the eyes in {W}. None if it is the map or would pass through the eyes."""
        if self.kind is None:
            return None
        ahead = vector.direction(vector.azimuth(direction), 0.0)
        through = vector.add(eyes_m, vector.scale(ahead, START_M))
        if self.kind == "horizontal":
            through = (through[0], through[1], feet_m[2] + self.height_m)
        elif self.kind == "cylinder":
            through = vector.add(feet_m, vector.scale(ahead, START_M))
        try:
            return Workspace(self.kind, through, feet_m=feet_m, eyes_m=eyes_m)
        except WorkspaceError:
            return None
