"""The workspace that a person begins with, before they ask for one."""

from dataclasses import dataclass

from pointit.geometry import vector
from pointit.geometry.plane import GRAZING_RAD
from pointit.geometry.vector import Vec3
from pointit.services.pui.workspace import Workspace, WorkspaceError, WorkspaceKind


@dataclass(frozen=True, kw_only=True)
class WorkspaceStart:
    """Which it is, and where it lies about whoever begins to point."""

    kind: WorkspaceKind | None = None
    """None: the map."""
    height_m: float = 0.0
    """Of the horizontal plane above the person's feet."""
    distance_m: float = 2.0
    """Of the others from the person."""
    grazing_rad: float = GRAZING_RAD
    """Rays closer to parallel do not meet it, nor one that is asked for later."""

    def create(self, eyes_m: Vec3, direction: Vec3, feet_m: Vec3) -> Workspace | None:
        """Return it for a ray from the eyes in {W}, or none: the map, or it would pass through the eyes."""
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
