"""Workspace of a person before they request one."""

from dataclasses import dataclass

from pointit.geometry import vector
from pointit.geometry.plane import GRAZING_RAD
from pointit.geometry.vector import Vec3
from pointit.services.pui.workspace import Workspace, WorkspaceError, WorkspaceKind


@dataclass(frozen=True, kw_only=True)
class WorkspaceStart:
    """Kind and position of the workspace relative to a person who starts to point."""

    kind: WorkspaceKind | None = None
    """Kind of the workspace. None: the map."""
    height_m: float = 0.0
    """Height of the horizontal plane above the person's feet."""
    distance_m: float = 2.0
    """Distance of the others from the person."""
    grazing_rad: float = GRAZING_RAD
    """Minimum angle between ray and workspace, also for later requests."""

    def create(self, eyes_m: Vec3, direction: Vec3, feet_m: Vec3) -> Workspace | None:
        """Return it for a ray from the eyes in {W}. None if it is the map or would pass through the eyes."""
        if self.kind is None:
            return None
        ahead = vector.direction(vector.azimuth(direction), 0.0)
        through = vector.add(eyes_m, vector.scale(ahead, self.distance_m))
        if self.kind == "horizontal":
            through = (through[0], through[1], feet_m[2] + self.height_m)
        elif self.kind == "cylinder":
            through = vector.add(feet_m, vector.scale(ahead, self.distance_m))
        try:
            return Workspace(self.kind, through, feet_m=feet_m, eyes_m=eyes_m, grazing_rad=self.grazing_rad)
        except WorkspaceError:
            return None
