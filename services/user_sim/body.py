"""The body of a simulated person: arm, feet, and errors of pointing.

The +2.8 deg of pitch there count downwards, like the original toolkit's pitch. Recordings of pointing at the
floor have the ray 2.5 deg below the target (between people 2.1, within a person 1.0), those at a wall 0.7 deg
below it (3.1, 2 to 5), so people point too low on average, some too high.
"""

import math

import numpy as np

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import AimConfig, ArmConfig
from pointit.sim.aim import Aim, Tremor

State = tuple[float, float, float]
"""Angle, rate and acceleration of one axis, rad, rad/s, rad/s²."""

USUAL_REACH_RAD = math.radians(39.0)
"""Amplitude of reaches at which the scatter was measured. It is proportional to amplitude (Schmidt's law)."""
LOW_DEG = -2.8
"""Mean of the elevation error without feedback, degrees."""
LOW_SD_DEG = 2.8
"""Its standard deviation between people, degrees."""
REACH_SD_DEG = 1.0
"""Its standard deviation of reaches, degrees."""
BENT_ARM_RAD = (math.radians(5.0), math.radians(10.0))
SECOND_SHARE = 1.0 / 3.0
"""Second pole of the wandering, as a share of the correlation time, so that little of it is above 2 Hz."""

STEADIER = 0.5
"""Share by which skill 1 reduces the noise."""

EASING_S = 0.5
"""Time constant of changes of the noise level, s."""

STEP_S = 1.0
"""Duration of a shift of the weight, or of a small step, s."""


class OpenLoopError:
    """A person's own bias, and a new random error for every reach."""

    def __init__(self, config: AimConfig, skill: float, rng: np.random.Generator) -> None:
        """Create for a person with `skill`, 0 to 1."""
        self._config = config
        self._rng = rng
        drawn_deg = LOW_DEG + LOW_SD_DEG * float(rng.standard_normal())
        given_deg = config.elevation_bias_deg
        self._clumsy = 1.0 - skill
        bias_deg = self._clumsy * drawn_deg if given_deg is None else given_deg
        self.bias_rad = math.radians(bias_deg)
        """Mean elevation above the target, rad."""
        self.now_rad: tuple[float, float] = (0.0, 0.0)
        """Azimuth and elevation error of the current reach, rad."""
        self.draw(0.0)

    def draw(self, amplitude_rad: float) -> None:
        """Draw a new error for a reach of `amplitude_rad`."""
        config = self._config
        rng = self._rng
        share = min(amplitude_rad / USUAL_REACH_RAD, 1.0)
        azimuth_sd_rad = math.radians(config.azimuth_error_reach_sd_deg) * share
        azimuth = azimuth_sd_rad * float(rng.standard_normal())
        elevation_sd_rad = math.radians(REACH_SD_DEG) * share
        elevation = elevation_sd_rad * float(rng.standard_normal())
        if rng.random() < config.bent_arm_share:
            step = float(rng.uniform(*BENT_ARM_RAD))
            if rng.random() >= 0.5:
                step = -step
            if rng.random() < 0.5:
                azimuth += step
            else:
                elevation += step
        self.now_rad = (self._clumsy * azimuth, self.bias_rad + self._clumsy * elevation)


def minimum_jerk_to_rest(start: State, duration_s: float, elapsed_s: float) -> State:
    """Return the state `elapsed_s` after `start` on the minimum-jerk path to rest at 0.

    The quintic with given position, rate and acceleration at both ends (Hoff and Arbib 1993): a reach may
    start from any movement without a jerk, and a reach from rest has the classic bell-shaped speed.
    """
    if elapsed_s >= duration_s:
        return (0.0, 0.0, 0.0)

    # Normalize: time as a share of the duration, and the state at the start in this unit
    s = max(elapsed_s, 0.0) / duration_s
    s2 = s * s
    s3 = s**3
    s4 = s**4
    s5 = s**5
    x = start[0]
    v = start[1] * duration_s
    a = start[2] * duration_s**2 / 2.0

    # The quintic and its derivatives
    position = (
        x * (1 - 10 * s3 + 15 * s4 - 6 * s5)
        + v * (s - 6 * s3 + 8 * s4 - 3 * s5)
        + a * (s2 - 3 * s3 + 3 * s4 - s5)
    )
    rate = (
        x * (-30 * s2 + 60 * s3 - 30 * s4)
        + v * (1 - 18 * s2 + 32 * s3 - 15 * s4)
        + a * (2 * s - 9 * s2 + 12 * s3 - 5 * s4)
    )
    acceleration = (
        x * (-60 * s + 180 * s2 - 120 * s3)
        + v * (-36 * s + 96 * s2 - 60 * s3)
        + a * (2 - 18 * s + 36 * s2 - 20 * s3)
    )
    return (position, rate / duration_s, acceleration / duration_s**2)


class Arm:
    """An arm that follows an aim, with reaches from one aim to the next."""

    def __init__(self, aim: Aim, config: ArmConfig, rng: np.random.Generator, skill: float = 0.0) -> None:
        """Create at rest on `aim`. `skill` of the person, 0 to 1."""
        self._config = config
        self._rng = rng
        self._aim = aim
        self._start: tuple[State, State] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self._began_ns = 0
        self._at_ns: int | None = None
        """Time of `_at`, ns."""
        self._at = self._start
        self._duration_s = config.reach_base_s
        self._noise = PosturalNoise(config, rng, skill)

    @property
    def reached_ns(self) -> int:
        """Return the time at which the last reach is complete, ns."""
        return self._began_ns + round(self._duration_s * NS_PER_S)

    def amplitude_rad(self, now_ns: int, aim: Aim) -> float:
        """Return the angle from the arm's direction to `aim`."""
        azimuth, elevation = self.deviation(now_ns)
        old = self._aim
        here = vector.direction(old.azimuth_rad + azimuth, old.elevation_rad + elevation)
        target = vector.direction(aim.azimuth_rad, aim.elevation_rad)
        return vector.angle_between(here, target)

    def reach_s(self, amplitude_rad: float, *, with_cursor: bool = False) -> float:
        """Return a random duration of a reach of `amplitude_rad`, s (Fitts: 39 deg in 0.74 s).

        It is longer with a cursor, as people slow down to steer by it.
        """
        config = self._config
        bits = math.log2(amplitude_rad / math.radians(config.reach_width_deg) + 1.0)
        usual_s = config.reach_base_s + config.reach_per_bit_s * bits
        if with_cursor:
            usual_s *= config.reach_with_cursor
        return usual_s * math.exp(config.reach_spread * self._rng.standard_normal())

    def start_hold(self) -> None:
        """Draw a new level of postural noise, as it differs from hold to hold."""
        self._noise.draw()

    def reach(self, now_ns: int, aim: Aim, duration_s: float) -> None:
        """Start a reach from the current orientation to `aim`, complete after `duration_s`."""
        azimuth, elevation = self._states(now_ns)
        old = self._aim
        self._aim = aim

        # Position, rate and acceleration relative to the new aim, so that none of them jumps
        azimuth_rad = vector.wrap(old.azimuth_rad + azimuth[0] - aim.azimuth_rad)
        azimuth_rate_radps = old.azimuth_rate_radps + azimuth[1] - aim.azimuth_rate_radps
        elevation_rad = old.elevation_rad + elevation[0] - aim.elevation_rad
        elevation_rate_radps = old.elevation_rate_radps + elevation[1] - aim.elevation_rate_radps
        self._start = (
            (azimuth_rad, azimuth_rate_radps, azimuth[2]),
            (elevation_rad, elevation_rate_radps, elevation[2]),
        )
        self._began_ns = now_ns
        self._duration_s = duration_s
        self._at_ns = None

    def deviation(self, now_ns: int) -> tuple[float, float]:
        """Return the offset of the arm from its aim, azimuth and elevation, rad, without postural noise."""
        azimuth, elevation = self._states(now_ns)
        return (azimuth[0], elevation[0])

    def follow(self, now_ns: int, aim: Aim) -> Quaternion:
        """Return the arm's orientation in {W} with the updated `aim`."""
        self._aim = aim
        azimuth, elevation = self.deviation(now_ns)
        noise_azimuth, noise_elevation = self._noise.at(now_ns)
        azimuth_rad = aim.azimuth_rad + azimuth + noise_azimuth
        elevation_rad = aim.elevation_rad + elevation + noise_elevation
        return rotation.from_azimuth_elevation(azimuth_rad, elevation_rad)

    def _states(self, now_ns: int) -> tuple[State, State]:
        if now_ns != self._at_ns:
            elapsed_s = (now_ns - self._began_ns) / NS_PER_S
            self._at_ns = now_ns
            azimuth, elevation = self._start
            self._at = (
                minimum_jerk_to_rest(azimuth, self._duration_s, elapsed_s),
                minimum_jerk_to_rest(elevation, self._duration_s, elapsed_s),
            )
        return self._at


class PosturalNoise:
    """Wandering of two axes (noise through two poles) with tremor (tones of 6 to 12 Hz).

    With poles of 0.3 and 0.1 s, 62 % of the wandering's variance is below 0.5 Hz, 23 % up to 1 Hz, 11 % up to
    2 Hz, 3 % up to 4 Hz and under 1 % above. Measured: 65, 17, 14, under 4, under 1 (pointing.md §7).
    """

    def __init__(self, config: ArmConfig, rng: np.random.Generator, skill: float = 0.0) -> None:
        self._rng = rng
        self._spread = config.hold_spread
        steady = 1.0 - STEADIER * skill
        yaw_sd_rad = steady * math.radians(config.hold_yaw_sd_deg)
        pitch_sd_rad = steady * math.radians(config.hold_pitch_sd_deg)
        self._sd_rad = (yaw_sd_rad, pitch_sd_rad)
        self._poles_s = (config.hold_correlation_s, SECOND_SHARE * config.hold_correlation_s)
        first_s, second_s = self._poles_s
        self._source_variance = (first_s + second_s) / first_s
        y = rng.standard_normal(2)
        x = rng.standard_normal(2)
        more = math.sqrt(self._source_variance - 1.0)

        # A stationary start: the driving noise is correlated with the wandering
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
            self._step = self._transition_over(passed_s)
            self._passed_s = passed_s
        keep, follow, keep_second, a, b, c = self._step
        n = self._rng.standard_normal(4).tolist()

        # Driving noise (y) and wandering (x) of each axis, with two independent normal numbers each
        states: list[tuple[float, float]] = []
        for axis, (y, x) in enumerate(self._state):
            first = n[2 * axis]
            second = n[2 * axis + 1]
            next_y = keep * y + a * first
            next_x = follow * y + keep_second * x + b * first + c * second
            states.append((next_y, next_x))
        self._state = states

        # Level of this hold, and tremor
        self._factor += (self._wanted - self._factor) * (1.0 - math.exp(-passed_s / EASING_S))
        (_, yaw), (_, pitch) = states
        yaw_sd_rad, pitch_sd_rad = self._sd_rad
        yaw_tremor_rad, pitch_tremor_rad = self._tremor.step(passed_s)
        yaw_rad = self._factor * yaw_sd_rad * yaw + yaw_tremor_rad
        pitch_rad = self._factor * pitch_sd_rad * pitch + pitch_tremor_rad
        return (yaw_rad, pitch_rad)

    def _transition_over(self, passed_s: float) -> tuple[float, float, float, float, float, float]:
        """Return the exact update of the state over a step: three factors, the noise's triangular matrix."""
        first_s, second_s = self._poles_s
        k1 = math.exp(-passed_s / first_s)
        k2 = math.exp(-passed_s / second_s)
        c = first_s * (k1 - k2) / (first_s - second_s)
        s2 = self._source_variance
        yy = s2 * (1.0 - k1 * k1)
        yx = 1.0 - k1 * (c * s2 + k2)
        xx = 1.0 - (c * c * s2 + 2.0 * c * k2 + k2 * k2)
        low = math.sqrt(max(yy, 0.0))
        cross = yx / low if low > 0.0 else 0.0
        return (k1, c, k2, low, cross, math.sqrt(max(xx - cross * cross, 0.0)))


class StandingPosition:
    """Random steps to spots around a position."""

    def __init__(self, place_m: Vec3, sd_m: float, every_s: float, rng: np.random.Generator) -> None:
        """Start at `place_m`; spots lie `sd_m` (1 sigma in x and y) around it, `every_s` apart on average."""
        self._place_m = place_m
        self._sd_m = sd_m
        self._every_s = every_s
        self._rng = rng
        self._from: tuple[float, float] = (0.0, 0.0)
        self._spot: tuple[float, float] = (0.0, 0.0)
        self._began_ns = 0
        self._next_ns: int | None = None

    def at(self, now_ns: int) -> Vec3:
        """Return the position at `now_ns`, {W}."""
        if self._sd_m == 0.0:
            return self._place_m
        if self._next_ns is None:
            self._next_ns = self._next_step_ns(now_ns)
        elif now_ns >= self._next_ns:
            x, y = self._sd_m * self._rng.standard_normal(2)
            self._from = self._spot
            self._spot = (float(x), float(y))
            self._began_ns = now_ns
            self._next_ns = self._next_step_ns(now_ns)
        elapsed_s = max(0, now_ns - self._began_ns) / NS_PER_S
        remaining, _, _ = minimum_jerk_to_rest((1.0, 0.0, 0.0), STEP_S, elapsed_s)
        from_x, from_y = self._from
        spot_x, spot_y = self._spot
        x = spot_x + remaining * (from_x - spot_x)
        y = spot_y + remaining * (from_y - spot_y)
        return vector.add(self._place_m, (x, y, 0.0))

    def _next_step_ns(self, now_ns: int) -> int:
        wait_s = STEP_S + float(self._rng.exponential(self._every_s))
        return now_ns + round(wait_s * NS_PER_S)
