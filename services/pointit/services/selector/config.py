"""Parameters of selecting."""

from typing import Literal, Self

from pydantic import Field, model_validator

from pointit.runtime.config.config import Config


class GaugeConfig(Config):
    """How an object's gauge fills (pointing.md §6).

    The times and the speed were chosen with `pointit evaluate selection`, for fast packages too; there they
    are 0.8 s, 0.5 s and 8 degrees/s.
    """

    full_s: float = Field(
        default=0.5, gt=0, le=10, description="pointing steadily fills the gauge in this, s"
    )
    sparse_full_s: float = Field(
        default=0.35, gt=0, le=10, description="the same where no other object is near, s"
    )
    sparse_deg: float = Field(
        default=10.0, ge=0, le=180, description="another object is near within this angle of the ray, degrees"
    )
    snap_deg: float = Field(
        default=1.5,
        ge=0,
        le=1.5,
        description="an object is hovered this far beside its half width, degrees at the eyes",
    )
    aim: Literal["cursor", "ray"] = Field(
        default="cursor",
        description="what angles are taken from: the cursor as it is shown on a strip or belt (people see "
        "and correct no error across it), or always the ray itself",
    )
    hysteresis: float = Field(
        default=0.3,
        ge=0,
        lt=1,
        description="the hovered object is kept until another one's angle is smaller by this share",
    )
    steady_deg_per_s: float = Field(
        default=12.0,
        gt=0,
        le=1000,
        description="the gauge fills while ray and object move slower than this to each other, degrees/s",
    )
    speed_window_s: float = Field(
        default=0.15, ge=0.02, le=1, description="time over which that speed is estimated, s"
    )
    drain_share: float = Field(
        default=0.5,
        ge=0,
        le=10,
        description="gauges of objects not hovered drain at this share of the rate of filling",
    )
    leave_factor: float = Field(
        default=1.5,
        ge=1,
        le=10,
        description="who is farther from an object than this many times its tolerance has left it",
    )
    leave_s: float = Field(
        default=0.3, ge=0, le=10, description="so long left, a filled gauge may fill once more, s"
    )
    aim_sigma_deg: float = Field(
        default=1.5, gt=0, le=45, description="1 sigma of people's aim, for the confidence, degrees"
    )


class JournalConfig(Config):
    """What is kept on disk: the audit, and what is selected (§ `pointit audit`)."""

    enabled: bool = Field(default=True, description="keep selections and their audit on disk")
    keep_days: float = Field(
        default=30.0, gt=0, le=3650, description="the audit goes back so far, days; older events are dropped"
    )
    restore_within_s: float = Field(
        default=600.0,
        ge=0,
        description="selections are taken up again by who starts within this of the last sign of life, s",
    )


Method = Literal["hold", "fraction", "gauge"]
"""How staying on an object selects it."""


class SelectorConfig(Config):
    """When a cursor is on an object, and when staying there toggles it."""

    method: Method = Field(
        default="gauge",
        description="gauge: it fills while one points steadily at an object; hold: on the same object at "
        "every timestep of the window; fraction: on a share of them",
    )
    mode: Literal["toggle", "select_only"] = Field(
        default="toggle", description="toggle: staying on one's selected object deselects it"
    )
    confirm: Literal["none", "press"] = Field(
        default="none", description="press: staying selects nothing, the person's button does"
    )
    confirm_gesture: Literal["press", "double", "hold"] = Field(
        default="press",
        description="gesture of the button that confirms; the supervisor takes them all too, press ends "
        "the pointing",
    )
    look_back_s: float = Field(
        default=0.15,
        ge=0.1,
        le=0.25,
        description="a press means what was hovered so long before it: pressing moves the arm, s",
    )
    window_s: float = Field(
        default=0.8, gt=0, le=10, description="hold, fraction: time on an object that toggles it, s"
    )
    timestep_s: float = Field(
        default=0.1, ge=0.005, le=2, description="hold, fraction: the window is looked at in steps of this, s"
    )
    fraction: float = Field(
        default=0.8, gt=0, le=1, description="share of the window's timesteps that `fraction` asks for"
    )
    release_s: float = Field(
        default=0.5,
        gt=0,
        le=10,
        description="hold, fraction: time off a toggled object before it can be toggled again, s",
    )
    margin_m: float = Field(
        default=0.05,
        ge=0,
        le=2,
        description="hold, fraction: the cursor may be this far beside an object, m",
    )
    gauge: GaugeConfig = Field(default=GaugeConfig(), description="of the method of that name")
    show_after_s: float = Field(
        default=0.15, ge=0, le=5, description="progress is shown, and an object reserved, from then on, s"
    )
    reserve_s: float = Field(
        default=0.5, ge=0, le=10, description="an object stays reserved so long after it was left, s"
    )
    display_lag_s: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="how much later than its stamp an object's place is seen: lights, cameras, s",
    )
    longest_gap_s: float = Field(
        default=0.25, gt=0, le=5, description="longer without a cursor, nothing is known to be pointed at, s"
    )
    objects_stale_after_s: float = Field(
        default=1.0, gt=0, le=60, description="objects not heard of for longer cannot be hovered, s"
    )
    left_after_s: float = Field(
        default=0.5,
        ge=0,
        le=60,
        description="an object that its tracker lists no longer has left after this; trackers flicker, s",
    )
    unseen_after_s: float = Field(
        default=30.0,
        gt=0,
        le=3600,
        description="selected objects whose tracker is silent, or not there after a restart, are given up "
        "after this, s",
    )
    ownerless_after_s: float = Field(
        default=10.0,
        ge=0,
        le=3600,
        description="what a person selected who is gone so long may be deselected by anybody, s",
    )
    lead_s: float = Field(
        default=0.25,
        ge=0,
        le=5,
        description="an object whose way to a bay is decided within this is refused: what was pointed at and "
        "decided takes so long to get to the conveyor, s",
    )
    undo_steps: int = Field(
        default=20, ge=1, le=1000, description="so many (de)selections of a person can be taken back"
    )
    journal: JournalConfig = Field(default=JournalConfig(), description="what is kept on disk")

    @model_validator(mode="after")
    def _window_holds_a_timestep(self) -> Self:
        if self.window_s < self.timestep_s:
            raise ValueError(f"window_s ({self.window_s}) must be at least timestep_s ({self.timestep_s})")
        return self

    @property
    def dwell_s(self) -> float:
        """Return the time on an object that selects it by the method in use, s."""
        return self.gauge.full_s if self.method == "gauge" else self.window_s
