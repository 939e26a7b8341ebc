"""Simulated people as they are tried: of common measures, each new to every trial."""

from typing import Literal

from pointit.evaluation.selection_world import Somebody
from pointit.schemas import UserProfile
from pointit.schemas.base import Rgb, Vec3
from pointit.services.user_sim.config import UserSimConfig

COLORS: tuple[Rgb, ...] = ((255, 255, 255), (0, 158, 115), (204, 121, 167), (86, 180, 233))
"""Of their cursors, in turn."""
PATTERNS: tuple[Literal["solid", "dashed", "striped", "dotted"], ...] = (
    "solid",
    "dashed",
    "striped",
    "dotted",
)

YAW_DEG = 20.0
"""Where their bands' yaw origin lies."""


def person(index: int, position_m: Vec3, target_kind: str) -> Somebody:
    """Return somebody who stands at `position_m` and selects packages of `target_kind`."""
    return Somebody(
        name=f"person-{index + 1}",
        config=UserSimConfig(
            position_m=position_m,
            yaw_deg=YAW_DEG,
            target_kinds=(target_kind,),
            think_s=0.0,
        ),
        profile=UserProfile(
            stamp_ns=0,
            cursor_color=COLORS[index % len(COLORS)],
            pattern=PATTERNS[index % len(PATTERNS)],
        ),
    )
