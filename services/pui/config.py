"""Parameters of the pointing-based user interface."""

from typing import Literal

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.services.pui.surfaces import OPAQUE, Kind, SolidKind


class PuiConfig(Config):
    """Map, pointable surfaces and tolerances, and the people of a shard."""

    map: str | None = Field(
        default=None,
        min_length=1,
        description="shipped map (lab, conveyor, vr_belts, arena, shelf), or path of a YAML file, from the "
        "current folder; lab if empty, but in a shard the site's map, unless that has point clouds",
    )
    people: tuple[str, ...] = Field(
        default=(),
        description="people whom this instance serves as a shard, which needs a name of its own (pui.NAME); "
        "[]: all whom no shard serves",
    )
    surfaces: tuple[Kind, ...] = Field(
        default=("strip", "belt"),
        min_length=1,
        description="kinds of things in the map that a cursor can be on; missing kinds are ignored, "
        "and with a workspace all may be missing",
    )
    priority: dict[str, int] = Field(
        default_factory=dict[str, int],
        description="priority by id or kind; the highest within the tolerance is pointed at; by default "
        "strips, belts and lamps have 2, points 1, all else 0",
    )
    opaque: tuple[SolidKind, ...] = Field(
        default=OPAQUE, description="kinds that hide what is behind them, whether pointable or not; []: none"
    )
    tolerance_deg: float = Field(
        default=12.0,
        gt=0,
        lt=90,
        description="maximum angle between ray and surface for a cursor, degrees at the eyes",
    )
    lamp_angles_deg: float = Field(
        default=0.0,
        ge=0,
        le=180,
        description="cursors list every lamp within this angle of the ray, degrees; 0: no lamps",
    )
    workspace: Literal["none", "horizontal", "facing", "cylinder", "sphere"] = Field(
        default="none",
        description="surface around each person on which their cursor moves instead of on the map's things, "
        "created again whenever they start to point, until they request another",
    )
    workspace_height_m: float = Field(
        default=0.0,
        ge=-10,
        le=10,
        description="height of the horizontal workspace above the person's feet, m",
    )

    @property
    def map_to_read(self) -> str:
        """Return the name or path of the map, or `""` if it is the site's."""
        return self.map or ("" if self.people else "lab")
