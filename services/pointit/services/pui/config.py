"""Parameters of the pointing-based user interface."""

from typing import Literal

from pydantic import Field

from pointit.runtime.config import Config


class PuiConfig(Config):
    """Which map, what in it can be pointed at, and how far off a ray may be."""

    map: str = Field(
        default="lab",
        min_length=1,
        description="name of a shipped map (lab), or path of a YAML file, relative to the current directory",
    )
    surfaces: tuple[Literal["strip", "belt", "lamp"], ...] = Field(
        default=("strip", "belt"),
        min_length=1,
        description="kinds of things in the map that a cursor can be on; kinds the map lacks are ignored",
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
    kd_step_m: float = Field(
        default=0.05, ge=0.005, le=1, description="spacing of the points of kd_tree on lines and ray, m"
    )
    kd_reach_m: float = Field(default=20.0, gt=0, le=100, description="length of the ray of kd_tree, m")
