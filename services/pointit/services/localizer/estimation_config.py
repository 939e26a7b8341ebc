"""Parameters of noise, of drift and of the stop criterion."""

import math
from dataclasses import replace
from typing import Any

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.services.localizer.drift.filter import DriftSettings
from pointit.services.localizer.estimation.estimator import SolverSettings

FREE_HEIGHT_M = 10.0
"""Standard deviation of an unknown height."""

_SETTINGS = SolverSettings()
_DRIFT = DriftSettings()


def _degrees(angle_rad: float) -> float:
    return round(math.degrees(angle_rad), 6)


def _in_radians(config: Config, *but: str) -> dict[str, Any]:
    """Return the fields of `config` except `but`; those in degrees are converted and named `…_rad…`."""
    return {
        name.replace("_deg", "_rad"): math.radians(value) if "_deg" in name else value
        for name, value in config
        if name not in but
    }


class TrustConfig(Config):
    """Noise of rays, and acceptance limits of poses."""

    ray_sigma_deg: float = Field(
        default=_degrees(_SETTINGS.ray_sigma_rad),
        gt=0,
        le=30,
        description="1 sigma sideways of pointing at moving targets, degrees",
    )
    elevation_sigma_deg: float = Field(
        default=_degrees(_SETTINGS.elevation_sigma_rad), gt=0, le=30, description="the same upwards, degrees"
    )
    act_sigma_deg: float = Field(
        default=_degrees(_SETTINGS.act_sigma_rad),
        gt=0,
        le=30,
        description="1 sigma sideways of one pointing at a target at rest, degrees",
    )
    bias_sigma_deg: float = Field(
        default=_degrees(_SETTINGS.bias_sigma_rad),
        gt=0,
        le=45,
        description="1 sigma of people's elevation bias, degrees; ~1 once known",
    )
    body_sigma_m: float = Field(
        default=_SETTINGS.body_sigma_m, ge=0, le=1, description="1 sigma of the eyes' horizontal position, m"
    )
    height_sigma_m: float = Field(
        default=_SETTINGS.height_sigma_m, ge=0, le=1, description="1 sigma of the height of the eyes, m"
    )
    independent_hz: float = Field(
        default=_SETTINGS.independent_hz,
        gt=0,
        le=100,
        description="independent pointings per second, Hz: a hold counts as one",
    )
    latency_sigma_s: float = Field(
        default=_SETTINGS.latency_sigma_s,
        ge=0,
        le=10,
        description="moving_target: 1 sigma of the latency of a tracker that does not state it "
        "(`TrackedObjects.latency_sigma_s`), s",
    )
    min_samples: int = Field(default=_SETTINGS.min_samples, ge=4, le=8192, description="rays needed, count")
    model_sigma_deg: float = Field(
        default=_degrees(_SETTINGS.model_sigma_rad),
        ge=0,
        le=45,
        description="1 sigma of a constant error of the rays, fixed to the body: eyes or finger "
        "off the model, degrees",
    )
    max_residual_deg: float = Field(
        default=_degrees(_SETTINGS.max_residual_rad),
        gt=0,
        le=90,
        description="moving_target: rms angle above which the person did not follow it, degrees",
    )
    max_act_residual_deg: float = Field(
        default=_degrees(_SETTINGS.max_act_residual_rad),
        gt=0,
        le=90,
        description="static_targets: rms angle above which the person did not point at the lamps, degrees",
    )
    bias_sigma_limit: float = Field(
        default=_SETTINGS.bias_sigma_limit,
        gt=0,
        le=10,
        description="sigmas of the elevation bias beyond which the person did not point",
    )
    max_position_sigma_m: float = Field(
        default=_SETTINGS.max_position_sigma_m,
        gt=0,
        le=10,
        description="poses less certain than this are refused, m; of following, cursors by 1.2 times it",
    )
    max_yaw_sigma_deg: float = Field(
        default=_degrees(_SETTINGS.max_yaw_sigma_rad),
        gt=0,
        le=90,
        description="poses less certain than this are refused, degrees",
    )

    def settings(self, *, free_height: bool = False) -> SolverSettings:
        """Return the settings of the solver."""
        settings = SolverSettings(**_in_radians(self))
        return replace(settings, height_sigma_m=FREE_HEIGHT_M) if free_height else settings


class StopCriterionConfig(Config):
    """Certainty at which localization by informative lamps ends: both values, or all lamps were used."""

    position_m: float = Field(
        default=0.45,
        gt=0,
        le=10,
        description="1 sigma of the position along its worse direction, m: two times of three the person "
        "stands nearer to what is stated; a pointing errs by 5 degrees, so that 3 to 5 lamps reach 0.45",
    )
    yaw_deg: float = Field(default=7.0, gt=0, le=90, description="1 sigma of the yaw, degrees")


class DriftConfig(Config):
    """Tracking of poses while the IMU's yaw drifts."""

    rate_sigma_degps: float = Field(
        default=_degrees(_DRIFT.rate_sigma_radps),
        gt=0,
        le=10,
        description="1 sigma of an IMU's yaw drift before it is known, degrees/s",
    )
    anchor_sigma_deg: float = Field(
        default=_degrees(_DRIFT.anchor_sigma_rad),
        gt=0,
        le=30,
        description="1 sigma of one pointing at a lamp, sideways, degrees",
    )
    max_yaw_sigma_deg: float = Field(
        default=15.0,
        gt=0,
        le=180,
        description="health warns if the yaw is less certain than this and trust.max_yaw_sigma_deg, degrees",
    )

    def settings(self) -> DriftSettings:
        """Return the settings of the filter."""
        return DriftSettings(**_in_radians(self, "max_yaw_sigma_deg"))
