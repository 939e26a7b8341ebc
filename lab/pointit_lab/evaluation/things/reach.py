"""A simulated person who points at one thing of a room and corrects by what its light shows."""

import math

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.user_sim.body import OpenLoopError
from pointit.services.user_sim.config import AimConfig, ArmConfig

RATE_HZ = 50.0
LOST_S = 0.9
"""Time without any light after which a person tries beside."""
SEARCH_RAD = tuple(
    (math.radians(right), math.radians(up))
    for right, up in ((0, 5), (0, -5), (5, 0), (-5, 0), (0, 10), (0, -10))
)
HALFWAY = 0.6
"""Share of the way from the thing that is shown to the one that is meant by which a person corrects."""
POSE_RAD = (math.radians(1.5), math.radians(0.7))
"""Standard deviation of the error of the pose at the eyes: sideways by yaw and place, upwards by place."""

Vector = NDArray[np.float64]


class ArmReach:
    """Azimuth and elevation of the ray of one person, who begins somewhere and reaches for a target."""

    def __init__(
        self,
        eyes_m: Vec3,
        targets_m: dict[str, Vec3],
        goal: str,
        rng: np.random.Generator,
        begin: "ArmReach | None" = None,
        *,
        bias_deg: float | None = None,
    ) -> None:
        """Begin where the reach `begin` ended, or with the arm low somewhere before the person.

        `bias_deg` is the person's mean elevation error, random if None.
        """
        self._rng = rng
        self._aim = AimConfig(elevation_bias_deg=bias_deg)
        self._arm = ArmConfig()
        self.errors: OpenLoopError = OpenLoopError(self._aim, 0.0, rng) if begin is None else begin.errors
        self._pose = np.array([rng.normal(0.0, sigma) for sigma in POSE_RAD])
        self._at = {name: angles(vector.subtract(at_m, eyes_m)) for name, at_m in targets_m.items()}
        self._goal = goal
        self._corrected = np.zeros(2)
        self._hold = np.radians([self._arm.hold_yaw_sd_deg, self._arm.hold_pitch_sd_deg])
        self._hold = self._hold * math.exp(rng.normal(0.0, self._arm.hold_spread))
        self._noise = np.zeros(2)
        self._tries = 0
        low = np.radians([rng.uniform(-30.0, 30.0), rng.uniform(-40.0, -20.0)])
        self.now: Vector = low if begin is None else begin.now
        amplitude = float(np.linalg.norm(self._at[goal] - self.now))
        self.errors.draw(amplitude)
        took_s = self._arm.reach_base_s + self._arm.reach_per_bit_s * math.log2(
            amplitude / math.radians(self._arm.reach_width_deg) + 1.0
        )
        took_s *= math.exp(rng.normal(0.0, self._arm.reach_spread)) * self._arm.reach_with_cursor
        self.took_s = took_s
        self._move(0.0, took_s)
        self._look_s = self._lit_s = took_s + self._aim.reaction_s
        self._shown: list[tuple[float, str | None]] = []

    @property
    def rest(self) -> Vector:
        """Return the azimuth and elevation to which the arm moves, rad."""
        return self._to

    def see(self, time_s: float, shown: str | None) -> None:
        """Note the thing whose light shows that it is pointed at."""
        self._shown.append((time_s, shown))

    def direction(self, time_s: float) -> Vec3:
        """Return the unit direction of the ray at `time_s`."""
        share = min(max((time_s - self._from_s) / self._took_s, 0.0), 1.0)
        done = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # least jerk
        keep = math.exp(-1.0 / RATE_HZ / self._arm.hold_correlation_s)
        step = self._hold * math.sqrt(1.0 - keep * keep)
        self._noise = keep * self._noise + step * self._rng.standard_normal(2)
        self.now = self._from + (self._to - self._from) * done + self._noise
        return vector.direction(float(self.now[0]), float(self.now[1]))

    def correct(self, time_s: float) -> None:
        """Move on if the light that was seen a moment ago is not that of the goal."""
        if time_s < self._look_s:
            return
        seen = [shown for at_s, shown in self._shown if at_s <= time_s - self._aim.visual_delay_s]
        steady = seen[-round(self._aim.correction_period_s * RATE_HZ / 2) :]
        shown = steady[-1] if steady else None
        if shown == self._goal:
            self._lit_s = time_s
        elif shown is not None and all(each == shown for each in steady):
            spread = 1.0 + self._aim.correction_spread * float(self._rng.standard_normal())
            self._corrected += HALFWAY * spread * (self._at[self._goal] - self._at[shown])
            self._again(time_s)
        elif shown is None and time_s - self._lit_s > LOST_S:
            self._corrected += SEARCH_RAD[self._tries % len(SEARCH_RAD)]
            self._tries += 1
            self._again(time_s)
            self._corrected -= SEARCH_RAD[(self._tries - 1) % len(SEARCH_RAD)]

    def _again(self, time_s: float) -> None:
        self._move(time_s, self._aim.correction_s)
        self._look_s = self._lit_s = time_s + self._aim.correction_s + self._aim.correction_period_s

    def _move(self, time_s: float, took_s: float) -> None:
        self._from, self._from_s, self._took_s = self.now - self._noise, time_s, took_s
        self._to: Vector = self._at[self._goal] + self.errors.now_rad + self._pose + self._corrected


def angles(sight: Vec3) -> Vector:
    """Return azimuth and elevation, rad."""
    return np.array([vector.azimuth(sight), vector.elevation(sight)])
