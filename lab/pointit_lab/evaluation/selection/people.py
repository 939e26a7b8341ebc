"""Simulated people of the evaluation: average body measures, created for every trial."""

from dataclasses import dataclass
from typing import Literal

from pointit.schemas import UserProfile
from pointit.schemas.base import Rgb, Vec3
from pointit.services.user_sim.config import AimConfig, MindConfig, UserSimConfig
from pointit_lab.evaluation.selection.world import TrialPerson

COLORS: tuple[Rgb, ...] = ((255, 255, 255), (0, 158, 115), (204, 121, 167), (86, 180, 233))
"""Cursor colours by person index."""
PATTERNS: tuple[Literal["solid", "dashed", "striped", "dotted"], ...] = (
    "solid",
    "dashed",
    "striped",
    "dotted",
)

YAW_DEG = 20.0
"""Azimuth of their bands' yaw origin."""


@dataclass(frozen=True, kw_only=True)
class PersonModel:
    """Parameters in which a simulated person differs from the default."""

    skill: float
    search_per_item_s: float
    decide_per_bit_s: float
    lapse_share: float


PRACTISED = PersonModel(skill=0.7, search_per_item_s=0.005, decide_per_bit_s=0.05, lapse_share=0.04)
"""Practised people, as in the paper's group: fitted to the medians and wrong toggles of `belts_lab`.
Targets pop out by colour (Wolfe: 5 ms an item), choosing among two or three of them is habit (Hick's slope
flattens with practice); the rate of lapses is 0.04 (1 - skill), 1.2 % of choices."""


def person(index: int, position_m: Vec3, target_kind: str, model: PersonModel = PRACTISED) -> TrialPerson:
    """Return a person at `position_m` who selects packages of `target_kind`."""
    return TrialPerson(
        name=f"person-{index + 1}",
        config=UserSimConfig(
            position_m=position_m,
            yaw_deg=YAW_DEG,
            target_kinds=(target_kind,),
            think_s=0.0,
            aim=AimConfig(skill=model.skill),
            mind=MindConfig(
                search_per_item_s=model.search_per_item_s,
                decide_per_bit_s=model.decide_per_bit_s,
                lapse_share=model.lapse_share,
            ),
        ),
        profile=UserProfile(
            stamp_ns=0,
            cursor_color=COLORS[index % len(COLORS)],
            pattern=PATTERNS[index % len(PATTERNS)],
        ),
    )
