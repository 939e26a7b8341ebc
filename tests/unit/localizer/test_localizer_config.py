"""Configuration reaches the cores; contradictions are refused."""

import math

import pytest
from pydantic import ValidationError

from pointit.services.localizer.certainty import UNSURE_DEG, UNSURE_M
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.drift.filter import DriftSettings
from pointit.services.localizer.estimation.estimator import SolverSettings
from pointit.services.localizer.estimation_config import DriftConfig, TrustConfig


def test_defaults_of_configuration_and_cores_are_equal() -> None:
    config = LocalizerConfig()
    want, have = SolverSettings(), config.believed()
    for name in want.__dataclass_fields__:
        assert getattr(have, name) == pytest.approx(getattr(want, name)), name
    drift, settings = config.drift.settings(), DriftSettings()
    assert drift.anchor_sigma_rad == pytest.approx(settings.anchor_sigma_rad)
    assert drift.rate_sigma_radps == pytest.approx(settings.rate_sigma_radps)
    assert want.max_position_sigma_m == UNSURE_M
    assert config.trust.max_yaw_sigma_deg == UNSURE_DEG


def test_lamps_and_robots_have_limits_of_their_own() -> None:
    trust = TrustConfig(
        max_residual_deg=20.0,
        max_act_residual_deg=3.0,
        act_sigma_deg=1.0,
        ray_sigma_deg=4.0,
        model_sigma_deg=0.0,
    ).settings()
    assert math.degrees(trust.max_residual_rad) == pytest.approx(20.0)
    assert math.degrees(trust.residual_limit_rad(is_still=True)) == pytest.approx(3.0)
    assert math.degrees(trust.noise_model(is_still=True).sigma_rad[0]) == pytest.approx(1.0)
    assert trust.model_sigma_rad == 0.0


def test_health_does_not_warn_of_what_localization_accepts() -> None:
    config = LocalizerConfig()
    assert config.drift.max_yaw_sigma_deg >= config.trust.max_yaw_sigma_deg
    with pytest.raises(ValidationError, match="every new pose would raise a warning"):
        LocalizerConfig(drift=DriftConfig(max_yaw_sigma_deg=8.0))
    LocalizerConfig(drift=DriftConfig(max_yaw_sigma_deg=8.0), trust=TrustConfig(max_yaw_sigma_deg=8.0))
