"""Tremor of a hand: a few tones of 6 to 12 Hz on each of two axes."""

import math

import numpy as np

TREMOR_HZ = (6.0, 12.0)
TREMOR_TONES = 3


class Tremor:
    """Two angles that tremble about 0, each of the same rms."""

    def __init__(self, rms_rad: float, rng: np.random.Generator) -> None:
        shape = (2, TREMOR_TONES)
        self._tone_radps = (math.tau * rng.uniform(*TREMOR_HZ, shape)).tolist()
        self._phase_rad = rng.uniform(0.0, math.tau, shape).tolist()
        self.rms_rad = rms_rad
        """Rms of each axis; may be set at any time."""

    def step(self, passed_s: float) -> tuple[float, float]:
        """Return both angles `passed_s` after the last step, rad."""
        if self.rms_rad == 0.0:
            return (0.0, 0.0)
        tone_rad = self.rms_rad * math.sqrt(2.0 / TREMOR_TONES)
        angles = [0.0, 0.0]
        for axis in (0, 1):
            phases = [
                (phase + rate * passed_s) % math.tau
                for phase, rate in zip(self._phase_rad[axis], self._tone_radps[axis], strict=True)
            ]
            self._phase_rad[axis] = phases
            angles[axis] = tone_rad * math.fsum(map(math.sin, phases))
        return (angles[0], angles[1])
