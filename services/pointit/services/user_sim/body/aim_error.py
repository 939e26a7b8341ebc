"""Error of pointing without feedback (pointing.md §3).

The +2.8 deg of pitch there count downwards, like the original toolkit's pitch. Recordings of pointing at the
floor have the ray 2.5 deg below the target (between people 2.1, within a person 1.0), those at a wall 0.7 deg
below it (3.1, 2 to 5), so people point too low on average, some too high.
"""

import math

import numpy as np

from pointit.services.user_sim.config import AimConfig

USUAL_REACH_RAD = math.radians(39.0)
"""Amplitude of reaches at which the scatter was measured. It is proportional to amplitude (Schmidt's law)."""
BENT_ARM_RAD = (math.radians(5.0), math.radians(10.0))


class OpenLoopError:
    """A person's own bias, and a new random error for every reach."""

    def __init__(self, config: AimConfig, skill: float, rng: np.random.Generator) -> None:
        """Create for a person with `skill`, 0 to 1."""
        self._config = config
        self._rng = rng
        drawn_deg = config.elevation_error_mean_deg + config.elevation_error_person_sd_deg * float(
            rng.standard_normal()
        )
        given_deg = config.elevation_bias_deg
        self._clumsy = 1.0 - skill
        self.bias_rad = math.radians(self._clumsy * drawn_deg if given_deg is None else given_deg)
        """Mean elevation above the target, rad."""
        self.now_rad: tuple[float, float] = (0.0, 0.0)
        """Azimuth and elevation error of the current reach, rad."""
        self.draw(0.0)

    def draw(self, amplitude_rad: float) -> None:
        """Draw a new error for a reach of `amplitude_rad`."""
        config, rng = self._config, self._rng
        share = min(amplitude_rad / USUAL_REACH_RAD, 1.0)
        azimuth = math.radians(config.azimuth_error_reach_sd_deg) * share * float(rng.standard_normal())
        elevation = math.radians(config.elevation_error_reach_sd_deg) * share * float(rng.standard_normal())
        if rng.random() < config.bent_arm_share:
            step = float(rng.uniform(*BENT_ARM_RAD)) * (1.0 if rng.random() < 0.5 else -1.0)
            azimuth, elevation = (
                (azimuth + step, elevation) if rng.random() < 0.5 else (azimuth, elevation + step)
            )
        self.now_rad = (self._clumsy * azimuth, self.bias_rad + self._clumsy * elevation)
