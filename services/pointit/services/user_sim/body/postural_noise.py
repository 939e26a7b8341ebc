"""Noise of a held hand: slow wandering and tremor."""

import math

import numpy as np

from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import ArmConfig
from pointit.sim.tremor import Tremor

SECOND_SHARE = 1.0 / 3.0
"""Second pole of the wandering, as a share of the correlation time, so that little of it is above 2 Hz."""
STEADIER = 0.5
"""Share by which skill 1 reduces the noise."""
EASING_S = 0.5
"""Time constant of changes of the noise level, s."""


class PosturalNoise:
    """Wandering of two axes (noise through two poles) with tremor (tones of 6 to 12 Hz).

    With poles of 0.3 and 0.1 s, 62 % of the wandering's variance is below 0.5 Hz, 23 % up to 1 Hz, 11 % up to
    2 Hz, 3 % up to 4 Hz and under 1 % above. Measured: 65, 17, 14, under 4, under 1 (pointing.md §7).
    """

    def __init__(self, config: ArmConfig, rng: np.random.Generator, skill: float = 0.0) -> None:
        """Create with the usual level of noise."""
        self._rng = rng
        self._spread = config.hold_spread
        steady = 1.0 - STEADIER * skill
        self._sd_rad = [
            steady * math.radians(sd_deg) for sd_deg in (config.hold_yaw_sd_deg, config.hold_pitch_sd_deg)
        ]
        self._poles_s = (config.hold_correlation_s, SECOND_SHARE * config.hold_correlation_s)
        first_s, second_s = self._poles_s
        self._source_variance = (first_s + second_s) / first_s
        y, x, more = rng.standard_normal(2), rng.standard_normal(2), math.sqrt(self._source_variance - 1.0)
        self._state = [(float(b + more * a), float(b)) for a, b in zip(y, x, strict=True)]
        """Driving noise and wandering of each axis. The wandering has variance 1."""
        self._passed_s = -1.0
        self._step = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._factor = self._wanted = 1.0
        self._tremor = Tremor(math.radians(config.tremor_rms_deg), rng)
        self._at_ns: int | None = None

    def draw(self) -> None:
        """Start another hold with a random level of noise."""
        self._wanted = math.exp(self._spread * float(self._rng.standard_normal()))

    def at(self, now_ns: int) -> tuple[float, float]:
        """Return the offsets of azimuth and elevation at `now_ns`, rad."""
        passed_s = 0.0 if self._at_ns is None else max(0, now_ns - self._at_ns) / NS_PER_S
        self._at_ns = now_ns
        if passed_s != self._passed_s:
            self._step = self._over(passed_s)
            self._passed_s = passed_s
        keep, follow, keep_second, a, b, c = self._step
        n = self._rng.standard_normal(4).tolist()
        self._state = [
            (keep * y + a * n[2 * k], follow * y + keep_second * x + b * n[2 * k] + c * n[2 * k + 1])
            for k, (y, x) in enumerate(self._state)
        ]
        self._factor += (self._wanted - self._factor) * (1.0 - math.exp(-passed_s / EASING_S))
        yaw, pitch = (
            self._factor * sd * x + tremor
            for sd, (_, x), tremor in zip(self._sd_rad, self._state, self._tremor.step(passed_s), strict=True)
        )
        return (yaw, pitch)

    def _over(self, passed_s: float) -> tuple[float, float, float, float, float, float]:
        """Return the exact update of the state over a step: three factors, the noise's triangular matrix."""
        first_s, second_s = self._poles_s
        k1, k2 = math.exp(-passed_s / first_s), math.exp(-passed_s / second_s)
        c = first_s * (k1 - k2) / (first_s - second_s)
        s2 = self._source_variance
        yy = s2 * (1.0 - k1 * k1)
        yx = 1.0 - k1 * (c * s2 + k2)
        xx = 1.0 - (c * c * s2 + 2.0 * c * k2 + k2 * k2)
        low = math.sqrt(max(yy, 0.0))
        cross = yx / low if low > 0.0 else 0.0
        return (k1, c, k2, low, cross, math.sqrt(max(xx - cross * cross, 0.0)))
