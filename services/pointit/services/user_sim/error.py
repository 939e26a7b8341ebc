"""How far beside people point when nothing shows them where they point (pointing.md §3)."""

import math

import numpy as np

from pointit.services.user_sim.config import AimConfig

USUAL_REACH_RAD = math.radians(39.0)
"""The reach at which the scatter was measured; shorter ones scatter in proportion (Schmidt's law)."""
BENT_ARM_RAD = (math.radians(5.0), math.radians(10.0))


class OpenLoopError:
    """A person's own bias, and a new scatter with every reach."""

    def __init__(self, config: AimConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng
        self._bias_rad = math.radians(
            config.elevation_error_mean_deg
            + config.elevation_error_person_sd_deg * float(rng.standard_normal())
        )
        self.now_rad: tuple[float, float] = (0.0, 0.0)
        """Azimuth and elevation of the present reach beside the intended ones."""
        self.draw(0.0)

    def draw(self, amplitude_rad: float) -> None:
        """Err anew, for a reach of `amplitude_rad`."""
        config, rng = self._config, self._rng
        share = min(amplitude_rad / USUAL_REACH_RAD, 1.0)
        azimuth = math.radians(config.azimuth_error_reach_sd_deg) * share * float(rng.standard_normal())
        elevation = math.radians(config.elevation_error_reach_sd_deg) * share * float(rng.standard_normal())
        if rng.random() < config.bent_arm_share:
            step = float(rng.uniform(*BENT_ARM_RAD)) * (1.0 if rng.random() < 0.5 else -1.0)
            azimuth, elevation = (
                (azimuth + step, elevation) if rng.random() < 0.5 else (azimuth, elevation + step)
            )
        clumsy = 1.0 - config.skill
        self.now_rad = (clumsy * azimuth, clumsy * (self._bias_rad + elevation))
