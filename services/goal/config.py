"""Parameters of goals."""

from typing import Literal

from pydantic import Field

from pointit.geometry.floor_sigma import ROBOT_PLACE_SIGMA_M
from pointit.runtime.config.config import Config


class GoalConfig(Config):
    """Robots or places that the person points at, permitted places, their confirmation, limits of refusal.

    Pointing is no safety function (pointing.md §9): a robot that follows goals must avoid people itself.
    """

    steer: Literal["places", "robots"] = Field(
        default="places",
        description="places: any robot is sent to a place pointed at in two steps; robots: a robot is taken "
        "by pointing at it, then follows the cursor (quadrotor) or goes a path of places (ground robot)",
    )
    take: Literal["press", "dwell"] = Field(
        default="press",
        description="gesture that takes a pointed robot: a press, or staying on it for dwell_s",
    )
    surfaces: tuple[str, ...] = Field(
        default=("workspace/horizontal",),
        description="surfaces for goals besides the level planes of the map, by the ids of cursors",
    )
    radius_m: float = Field(
        default=0.3,
        gt=0,
        le=5,
        description="radius within which a cursor stays at a place; at twice the radius it has left, and a "
        "second stay within one and a half radii is at the same place, m",
    )
    dwell_s: float = Field(
        default=1.0,
        ge=0.2,
        le=10,
        description="time of staying at a place that proposes it, or makes it a way-point, s",
    )
    confirm: Literal["again", "press"] = Field(
        default="again",
        description="places: confirmation of a proposed place: leave it and stay there again, or press "
        "the button, which ends the pointing unless supervisor.press_while_pointing is confirms",
    )
    confirm_s: float = Field(
        default=8.0,
        gt=0,
        le=60,
        description="time for the confirmation, with that second stay, before the proposal is withdrawn, s",
    )
    max_age_s: float = Field(
        default=0.2, gt=0, le=2, description="largest age of cursors that propose or confirm, s"
    )
    max_sigma_m: float = Field(
        default=ROBOT_PLACE_SIGMA_M,
        gt=0,
        le=10,
        description="largest uncertainty of a place, 1 sigma along its worse direction, m",
    )
    aim_sigma_deg: float = Field(
        default=2.0,
        ge=0,
        le=20,
        description="1 sigma of people's aim, which adds to that, more for flatter pointing: 1 if they "
        "see their cursor, 4 and more if they do not, deg",
    )
    keep_out_m: float = Field(
        default=0.5, ge=0, le=20, description="smallest distance from people whose position is known, m"
    )
