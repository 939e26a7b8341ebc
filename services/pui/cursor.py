"""One person's cursor: pose, pointing state, and where the ray meets the room."""

import math
from collections.abc import Sequence
from typing import TypeAlias

from pointit.geometry import vector
from pointit.geometry.polyline import Hit
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Feedback,
    Interaction,
    Lamp,
    LampMiss,
    PointingRay,
    SetWorkspace,
    UserPose,
)
from pointit.schemas.base import unchecked
from pointit.schemas.pointing import Solid, SurfaceKind
from pointit.services.pui.passing import Passing, is_in_range
from pointit.services.pui.surfaces import PLACES, Surfaces
from pointit.services.pui.tracked_objects import Tracked
from pointit.services.pui.workspace import Workspace, WorkspaceError, WorkspaceStart

_WorldRay: TypeAlias = tuple[Vec3, Vec3, Vec3, int]
"""Eyes, direction and feet of a ray in {W}, m, and its stamp, ns. A named tuple takes longer to make."""
_Intersection: TypeAlias = tuple[SurfaceKind, Solid, str, Hit]
"""Surface and solid of a cursor, id of what the ray meets, and where."""

STEEPEST_RAD = math.pi / 2.0

MAX_BIAS_RAD = math.radians(45.0)
"""Limit of the elevation bias of a pose. A larger bias is clamped."""

RIVAL_NS = 2 * NS_PER_S
"""Time for which a pose with an older stamp than the other source's last one is ignored, ns."""

WORKSPACE_ID = "workspace/"
"""First part of the `surface_id` of cursors on a workspace, before its kind. No id in a map has a slash."""

NO_WORKSPACE = WorkspaceStart()

_calculated_cursor = unchecked(Cursor)


class NearbyLamps:
    """Lamps within an angle of the ray, for lamps that answer by colour (paper, scenario 1)."""

    def __init__(self, lamps: Sequence[Lamp], within_rad: float) -> None:
        self._lamps = [(lamp.id, lamp.position_m) for lamp in lamps]
        self._within_rad = within_rad

    def near(self, origin_m: Vec3, direction: Vec3) -> tuple[LampMiss, ...]:
        """Return the lamps near the ray, the nearest first."""
        misses: list[tuple[float, str]] = []
        for name, position_m in self._lamps:
            to_lamp = vector.subtract(position_m, origin_m)
            miss_rad = vector.angle_between(direction, to_lamp)
            if miss_rad <= self._within_rad:
                misses.append((miss_rad, name))
        misses.sort()
        return tuple(LampMiss(id=name, miss_rad=miss_rad) for miss_rad, name in misses)


class PersonCursor:
    """One person's rays, in their own frame {H}, become cursors on the surfaces of the room, in {W}.

    It is the step that needs to know where the person stands: `set_pose` tells it, and without a pose there
    is no cursor (`lacks_pose`). A cursor says where on which surface the ray ends, such as 1.2 m along a
    strip, and is what lights, selection and pages show and use.

    There is a cursor for every ray while the person is pointing, with surface `none` if it passes everything:
    readers learn from it that the person has moved on, and where they look. Without interactions, as without
    a supervisor, the person is pointing all the time. `examples/core.py` shows it between ray and selection.
    """

    def __init__(
        self, surfaces: Surfaces, *, lamps: NearbyLamps | None = None, start: WorkspaceStart = NO_WORKSPACE
    ) -> None:
        """Create without a pose; with `lamps`, every cursor lists those near the ray."""
        self._surfaces = surfaces
        self.passing = Passing(surfaces)
        self._lamps = lamps
        self._start = start
        self._workspace: Workspace | None = None
        self._is_chosen = False
        """True if the person chose the workspace, or the map, instead of the initial one."""
        self._pointing = True
        self._pose: UserPose | None = None
        self._turn = (1.0, 0.0)
        """Cosine and sine of the pose's yaw."""
        self._feet_m: Vec3 = (0.0, 0.0, 0.0)
        self._bias_rad = 0.0
        """Position and elevation bias of the pose."""
        self._pose_received_ns = 0
        self._newest_ns = 0
        self._newest_ray: _WorldRay | None = None
        self._point: Vec3 | None = None
        """Current position of the cursor, or None."""
        self._is_shown = False
        self._seq = 0

    @property
    def lacks_pose(self) -> bool:
        """Return True if rays give no cursor because no pose is known."""
        return self._pose is None and self._pointing

    def change_map(self, surfaces: Surfaces, lamps: NearbyLamps | None) -> None:
        """Point at `surfaces` and `lamps`, of another map, from now on."""
        self._surfaces = surfaces
        self._lamps = lamps
        self.passing = Passing(surfaces)

    def set_pose(self, pose: UserPose, now_ns: int | None = None) -> None:
        """Set the pose that came at `now_ns`, None if there is only one source.

        A localizer and a tracker may both publish it for a moment. Then the newer one counts.
        """
        current = self._pose
        if now_ns is not None:
            is_recent = 0 <= now_ns - self._pose_received_ns <= RIVAL_NS
            if current is not None and is_recent and pose.stamp_ns < current.stamp_ns:
                return
            self._pose_received_ns = now_ns
        self._pose = pose
        self._turn = (math.cos(pose.yaw_rad), math.sin(pose.yaw_rad))
        self._feet_m = pose.position_m
        self._bias_rad = pose.elevation_bias_rad

    def set_interaction(self, interaction: Interaction) -> Cursor | None:
        """Set the person's interaction. Return the cursor that ends the pointing, once, if this ends it."""
        self._pointing = interaction.state == "pointing"
        return None if self._pointing else self.clear(interaction.stamp_ns)

    def set_workspace(self, query: SetWorkspace, tracked: Tracked) -> None:
        """Create the requested workspace in place of the map or of another, or return to the map.

        Raises:
            WorkspaceError: If it cannot be created. The old one stays.
        """
        if query.kind == "none":
            self._change_workspace(None)
            return
        if self._pose is None:
            raise WorkspaceError("no pose is known: localize first")
        if self._newest_ray is None:
            raise WorkspaceError("no ray has come yet: start the IMU, and point")
        eyes, direction, feet, stamp_ns = self._newest_ray
        anchor = self._anchor(query, tracked, stamp_ns)
        workspace = Workspace(query.kind, anchor, feet_m=feet, eyes_m=eyes)
        if query.anchor == "pointer":
            workspace.steer(direction, eyes, feet, anchor)
        self._change_workspace(workspace)

    def _change_workspace(self, workspace: Workspace | None) -> None:
        self._workspace = workspace
        self._is_chosen = True
        self.passing.end()

    def _anchor(self, query: SetWorkspace, tracked: Tracked, stamp_ns: int) -> Vec3:
        if query.anchor == "pointer":
            if self._point is None:
                raise WorkspaceError(
                    "there is no cursor now: point at something first, or name another anchor"
                )
            return self._point
        if query.anchor == "object":
            return tracked.where(query.object_id, stamp_ns)
        if query.point_m is None:
            raise WorkspaceError("the anchor is a point, but none is given: give point_m")
        return query.point_m

    def clear(self, stamp_ns: int) -> Cursor | None:
        """Return the empty cursor that removes the one shown, or None if none is shown."""
        self._point = None
        self.passing.end()
        if not self._is_chosen:
            self._workspace = None  # created again where they point next
        if not self._is_shown:
            return None
        self._is_shown = False
        self._seq += 1
        return Cursor(stamp_ns=max(stamp_ns, self._newest_ns), seq=self._seq)

    def cursor(self, ray: PointingRay) -> Cursor | None:
        """Return the cursor of `ray` with its stamp, or None while there is none."""
        if self._pose is None:
            return None
        # Turn eyes and direction from {H} into {W}. This runs for every ray, so the products are written out.
        cos_yaw, sin_yaw = self._turn
        feet = self._feet_m
        x, y, z = ray.origin_m
        eyes = (feet[0] + (cos_yaw * x - sin_yaw * y), feet[1] + (sin_yaw * x + cos_yaw * y), feet[2] + z)
        unbiased = ray.direction
        if self._bias_rad != 0.0:
            unbiased = _lowered(ray.direction, self._bias_rad)
        x, y, z = unbiased
        direction = vector.normalized((cos_yaw * x - sin_yaw * y, sin_yaw * x + cos_yaw * y, z))
        world_ray = (eyes, direction, feet, ray.stamp_ns)
        self._newest_ray = world_ray

        if not self._pointing:
            return None
        self._newest_ns = ray.stamp_ns
        self._is_shown = True
        if self._workspace is None and not self._is_chosen:
            self._workspace = self._start.create(eyes, direction, feet)
        return self._cursor(world_ray)

    def cue(self) -> Feedback | None:
        """Return a cue if the person has pointed past everything for a while with the last ray."""
        if self._point is not None:
            return None
        return self.passing.cue(self._newest_ns)

    def _cursor(self, ray: _WorldRay) -> Cursor:
        self._seq += 1
        eyes, direction, feet, stamp_ns = ray
        if not is_in_range(eyes):  # a pose beyond the limits of messages
            self._point = None
            self.passing.end()
            return Cursor(stamp_ns=stamp_ns, seq=self._seq)
        lamps: tuple[LampMiss, ...] = ()
        if self._lamps is not None:
            lamps = self._lamps.near(eyes, direction)

        # Nothing is met: the cursor has only the ray, and may tell how it passes
        intersection = self._intersect(eyes, direction, feet)
        if intersection is None or not is_in_range(intersection[3].point_m):
            self._point = None
            passed = None
            if self._workspace is None:
                passed = self.passing.miss(eyes, direction, stamp_ns)
            else:
                self.passing.end()
            return _calculated_cursor(
                stamp_ns=stamp_ns,
                seq=self._seq,
                origin_m=eyes,
                direction=direction,
                lamps=lamps,
                passed=passed,
            )

        surface, solid, surface_id, hit = intersection
        self._point = hit.point_m
        self.passing.end()
        return _calculated_cursor(
            stamp_ns=stamp_ns,
            seq=self._seq,
            surface=surface,
            surface_id=surface_id,
            point_m=hit.point_m,
            position_m=hit.position_m,
            miss_m=hit.miss_m,
            miss_rad=hit.miss_rad,
            range_m=hit.range_m,
            solid=solid,
            uv_m=hit.uv_m,
            origin_m=eyes,
            direction=direction,
            lamps=lamps,
        )

    def _intersect(self, eyes: Vec3, direction: Vec3, feet: Vec3) -> _Intersection | None:
        """Return where the ray meets the workspace, or else the map, or None if it meets nothing."""
        workspace = self._workspace
        if workspace is not None:
            hit = workspace.intersect(eyes, direction, feet)
            if hit is None:
                return None
            return "none", workspace.solid, WORKSPACE_ID + workspace.kind, hit
        surface_hit = self._surfaces.hit_test(eyes, direction)
        if surface_hit is None:
            return None
        place, hit = surface_hit
        surface, solid = PLACES[place.kind]
        return surface, solid, place.id, hit


def _lowered(direction: Vec3, bias_rad: float) -> Vec3:
    """Return `direction` with its elevation reduced by `bias_rad`, at most straight up or down."""
    bias_rad = max(-MAX_BIAS_RAD, min(MAX_BIAS_RAD, bias_rad))
    elevation_rad = vector.elevation(direction) - bias_rad
    return vector.direction(vector.azimuth(direction), max(-STEEPEST_RAD, min(STEEPEST_RAD, elevation_rad)))
