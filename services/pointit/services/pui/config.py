"""Parameters of the pointing-based user interface."""

from typing import Literal

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.services.pui.shapes import Kind, SolidKind
from pointit.services.pui.surfaces import OPAQUE


class PuiConfig(Config):
    """Which map, what in it can be pointed at, and how far off a ray may be."""

    map: str = Field(
        default="lab",
        min_length=1,
        description="a shipped map (lab, conveyor, vr_belts), or path of a YAML file from where it is run",
    )
    surfaces: tuple[Kind, ...] = Field(
        default=("strip", "belt"),
        min_length=1,
        description="kinds of things in the map that a cursor can be on; kinds the map lacks are ignored, "
        "and with a workspace it may lack all of them",
    )
    priority: dict[str, int] = Field(
        default_factory=dict[str, int],
        description="by id or kind; of all within the tolerance, the highest is pointed at; where nothing is "
        "said, strips, belts and lamps have 2, points 1, all else 0",
    )
    opaque: tuple[SolidKind, ...] = Field(
        default=OPAQUE,
        description="kinds that hide what is behind them, be they among the surfaces or not; [] for none",
    )
    method: Literal["exact", "kd_tree"] = Field(
        default="exact",
        description="closed form; or the paper's nearest neighbours of points on the ray, always in metres",
    )
    tolerance_deg: float = Field(
        default=12.0,
        gt=0,
        lt=90,
        description="a ray that misses by more makes no cursor, degrees at the eyes",
    )
    tolerance_m: float | None = Field(
        default=None,
        gt=0,
        le=20,
        description="if set, metres tell what is nearest and near enough, m; kd_tree: 0.7 if empty",
    )
    grazing_deg: float = Field(
        default=5.0,
        ge=0,
        lt=45,
        description="a plane or workspace closer to parallel to the ray is not pointed at, degrees",
    )
    lamp_angles_deg: float = Field(
        default=0.0,
        ge=0,
        le=180,
        description="cursors tell of every lamp within this angle of the ray, degrees; 0: of none",
    )
    workspace: Literal["none", "horizontal", "facing", "cylinder", "sphere"] = Field(
        default="none",
        description="surface about each person on which their cursor moves instead of on the map's things, "
        "laid anew whenever they begin to point, till they ask for another",
    )
    workspace_height_m: float = Field(
        default=0.0, ge=-10, le=10, description="of the horizontal workspace above the person's feet, m"
    )
    workspace_distance_m: float = Field(
        default=2.0, ge=0.2, le=100, description="of the other workspaces from the person, m"
    )
    kd_step_m: float = Field(
        default=0.05, ge=0.005, le=1, description="spacing of the points of kd_tree on lines and ray, m"
    )
    kd_reach_m: float = Field(default=20.0, gt=0, le=100, description="length of the ray of kd_tree, m")
