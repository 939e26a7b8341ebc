"""Parameters of goals."""

from typing import Literal

from pydantic import Field

from pointit.runtime.config.config import Config


class GoalConfig(Config):
    """Where a robot may be sent, how a person says so twice, and when it is refused.

    Pointing is no safety function (pointing.md §9): a robot that follows goals keeps away from people itself.
    """

    surfaces: tuple[str, ...] = Field(
        default=("workspace/horizontal",),
        description="what a goal can be on besides the level planes of the map, by the ids of cursors",
    )
    radius_m: float = Field(
        default=0.3,
        gt=0,
        le=5,
        description="a cursor that moves no farther stays; twice as far away a place has been left, and a "
        "second stay within one and a half times as far is at the same place, m",
    )
    dwell_s: float = Field(
        default=1.0, ge=0.2, le=10, description="staying at a place for so long proposes it, s"
    )
    confirm: Literal["again", "press"] = Field(
        default="again",
        description="what makes a proposed place a goal: to leave it and stay there again; or a press of "
        "the button, which ends the pointing unless supervisor.press_while_pointing is confirms",
    )
    confirm_s: float = Field(
        default=8.0,
        gt=0,
        le=60,
        description="time to confirm it, with that second stay; then it is taken back, s",
    )
    max_age_s: float = Field(
        default=0.2, gt=0, le=2, description="nothing is proposed or confirmed with older cursors, s"
    )
    max_sigma_m: float = Field(
        default=0.5,
        gt=0,
        le=10,
        description="a place that is less sure is refused: 1 sigma along its worse direction, m",
    )
    aim_sigma_deg: float = Field(
        default=2.0,
        ge=0,
        le=20,
        description="1 sigma of people's aim, which adds to that, more the flatter they point: 1 where they "
        "see their cursor, 4 and more where they do not, deg",
    )
    keep_out_m: float = Field(
        default=0.5, ge=0, le=20, description="nearer to a person whose place is known it is refused, m"
    )
