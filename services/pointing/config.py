"""Parameters of pointing."""

from typing import Literal

from pydantic import Field

from pointit.geometry.one_euro import OneEuro
from pointit.runtime.config.config import Config

MIN_CUTOFF_HZ = {"normal": 0.7, "steady": 0.3}
"""Cut-off of the filter by its setting; pointing.md §2."""


class PointingConfig(Config):
    """Age limit of orientations, and smoothing of the ray."""

    stale_after_s: float = Field(
        default=0.2,
        gt=0,
        le=10,
        description="maximum age of a sample, or time in the future, for which a ray is published, s",
    )
    profile_wait_s: float = Field(
        default=1.0,
        ge=0,
        le=60,
        description="longest wait for the person's measures at the start, before average ones are used, s",
    )
    filter: Literal["off", "normal", "steady"] = Field(
        default="normal", description="smoothing of the ray (1 € filter); steady: for hands that tremble"
    )
    min_cutoff_hz: float | None = Field(
        default=None,
        ge=0.01,
        le=100,
        description="the filter's cut-off at rest, Hz; lower is steadier and slower; "
        "if empty, that of the filter: 0.7 normal, 0.3 steady",
    )
    beta_hz_per_degps: float = Field(
        default=0.05, ge=0, le=10, description="increase of that cut-off with the speed, Hz per deg/s"
    )
    derivative_cutoff_hz: float = Field(
        default=1.0, ge=0.01, le=100, description="cut-off of the speed itself, Hz"
    )
    filter_gap_s: float = Field(
        default=0.5, ge=0.05, le=10, description="time without a ray after which the filter restarts, s"
    )

    def smoothing(self) -> OneEuro | None:
        """Return a new filter as configured, or None if it is off."""
        if self.filter == "off":
            return None
        return OneEuro(
            min_cutoff_hz=self.min_cutoff_hz or MIN_CUTOFF_HZ[self.filter],
            beta_hz_per_degps=self.beta_hz_per_degps,
            derivative_cutoff_hz=self.derivative_cutoff_hz,
            gap_s=self.filter_gap_s,
        )
