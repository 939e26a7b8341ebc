"""Parameters of the selector."""

from typing import Literal

from pydantic import Field, field_validator

from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import PluginConfig, PluginGroup
from pointit.services.selector.selection_methods import METHODS, MethodConfig, SelectionMethod

TIMESTEP_S = 0.1
"""Timestep of the window of methods `hold` and `fraction`, s."""


class GaugeConfig(Config):
    """Parameters of filling an object's gauge (pointing.md §6).

    The times and the speed were chosen with `pointit evaluate selection`, for fast packages too. That
    section has 0.8 s, 0.5 s and 8 degrees/s instead.
    """

    full_s: float = Field(
        default=0.5, gt=0, le=10, description="time of steady pointing that fills the gauge, s"
    )
    sparse_full_s: float = Field(
        default=0.35, gt=0, le=10, description="the same if no other object is near, s"
    )
    snap_deg: float = Field(
        default=1.5,
        ge=0,
        le=1.5,
        description="an object is hovered up to this angle beyond its half width, degrees at the eyes",
    )
    aim: Literal["cursor", "ray"] = Field(
        default="cursor",
        description="reference of angles: the cursor as shown on a strip or belt (people neither see "
        "nor correct an error across it), or always the ray itself",
    )
    steady_deg_per_s: float = Field(
        default=12.0,
        gt=0,
        le=1000,
        description="the gauge fills while the ray moves slower than this relative to the object, degrees/s",
    )
    aim_sigma_deg: float = Field(
        default=1.5,
        gt=0,
        le=45,
        description="standard deviation of people's aim, for the confidence, degrees",
    )


class JournalConfig(Config):
    """Storage of the audit (see `pointit audit`) and the current selections on disk."""

    enabled: bool = Field(default=True, description="store selections and their audit on disk")
    keep_days: float = Field(
        default=30.0, gt=0, le=3650, description="age beyond which events of the audit are deleted, days"
    )
    max_mb: float = Field(
        default=200.0,
        ge=1,
        description="size of the file beyond which the oldest refusals, then other old events go, MB",
    )
    restore_within_s: float = Field(
        default=600.0,
        ge=0,
        description="selections are restored on a start within this time after the last sign of life, s",
    )


class SelectorConfig(PluginConfig):
    """When an object is hovered, and when staying on it selects or deselects it."""

    method: str = Field(
        default="gauge",
        description="gauge: fills during steady pointing at an object; hold: the same object at "
        "every timestep of the window; fraction: the same object at a share of them; or a method of an "
        "installed package; `pointit plugin list` shows them",
    )
    mode: Literal["toggle", "select_only"] = Field(
        default="toggle", description="toggle: staying on an own selected object deselects it"
    )
    confirm: Literal["none", "press"] = Field(
        default="none", description="press: the person's button selects instead of staying"
    )
    window_s: float = Field(
        default=0.8, ge=TIMESTEP_S, le=10, description="hold, fraction: time on an object that toggles it, s"
    )
    fraction: float = Field(
        default=0.8, gt=0, le=1, description="share of the window's timesteps that method `fraction` requires"
    )
    margin_m: float = Field(
        default=0.05,
        ge=0,
        le=2,
        description="hold, fraction: distance beside an object within which the cursor hovers it, m",
    )
    gauge: GaugeConfig = Field(default=GaugeConfig(), description="parameters of method gauge")
    reserve_s: float = Field(
        default=0.5, ge=0, le=10, description="time for which an object stays reserved after it was left, s"
    )
    longest_gap_s: float = Field(
        default=0.25,
        gt=0,
        le=5,
        description="longest gap between cursors before the hovered object is unknown, s",
    )
    objects_stale_after_s: float = Field(
        default=1.0, gt=0, le=60, description="objects whose last report is older cannot be hovered, s"
    )
    unseen_after_s: float = Field(
        default=30.0,
        gt=0,
        le=3600,
        description="selected objects whose tracker is silent, or missing after a restart, are dropped "
        "after this, s",
    )
    ownerless_after_s: float = Field(
        default=10.0,
        ge=0,
        le=3600,
        description="absence of a person after which anyone may deselect what they selected, s",
    )
    lead_s: float = Field(
        default=0.25,
        ge=0,
        le=5,
        description="an object whose bay is decided within this time is refused: a selection takes this long "
        "to reach the conveyor, s",
    )
    people: tuple[str, ...] = Field(
        default=(),
        description="people whom this shard serves, `selector.NAME` beside their wrists; empty for the "
        "selector of the site, which serves all others and decides",
    )
    journal: JournalConfig = Field(default=JournalConfig(), description="the journal on disk")

    @classmethod
    def plugins(cls) -> PluginGroup[SelectionMethod]:
        """Return the installed methods. Those of this project have their parameters in this class."""
        return METHODS

    @field_validator("method")
    @classmethod
    def _installed(cls, method: str) -> str:
        METHODS.check_name(method)
        return method

    @property
    def dwell_s(self) -> float:
        """Return the time on an object that selects it by the method in use, s."""
        section = self.section(self.method)
        if isinstance(section, MethodConfig):
            return section.dwell_s
        return self.gauge.full_s if self.method == "gauge" else self.window_s
