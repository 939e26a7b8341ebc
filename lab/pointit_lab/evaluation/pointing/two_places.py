"""Directions in maps that simulated people pace, and selections by them: `python -m` this module.

Each seed is a person of `user-sim` (their own bias, and an error for every reach) in a room of lamps. They
point at all lamps from A, walk two metres aside, and point again. Then they point from A, B and between, and
correct by the name or light of the lamp that the map takes for theirs, before they press.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pointit.bridges.home_assistant.setup.progress import SetupProgress
from pointit.bridges.home_assistant.setup.stored_setup import ChosenLamp
from pointit.geometry.vector import Vec3
from pointit.services.user_sim.body import OpenLoopError
from pointit.services.user_sim.config import AimConfig, DecisionConfig, WristbandConfig

SEEDS = range(7100, 7120)
"""Seeds that nothing was tuned with."""
LAMPS = 8
EYES_M = 1.6
"""Assumed height of the eyes, m."""
EYES_SIGMA_M = 0.04
"""Standard deviation of the height of people's eyes, m."""
WALK_M = 2.0
WALK_SIGMA_M = 0.3
WALK_AZIMUTH_SIGMA_RAD = 0.35
SECONDS_A_PRESS = 4.0
WALK_S = 6.0
MIN_APART_RAD = math.radians(12.0)
"""Least angle between two lamps as seen from A: nearer ones are for *Told apart*."""
CAPTURE_RAD = math.radians(8.0)
"""Angle up to which the nearest lamp is the one that is meant."""
MAX_CORRECTIONS = 4
RESAMPLINGS = 300
"""Number of samples of the bootstrap."""
CORRECTED_SIGMA_RAD = math.radians(1.5)
"""Standard deviation of a small correction by what is heard or seen, per axis."""

Array = NDArray[np.float64]


@dataclass
class PlacesResult:
    """Errors of directions (°) from A, B and between; numbers of selections, and of acts on other lamps."""

    errors_deg: list[list[float]]
    tries: int = 0
    confirmed: int = 0
    wrong: int = 0
    presses: int = 0
    left_out: int = 0
    """Lamps that were not placed since their presses contradicted the others twice."""


def angles(lamps_m: Array, eyes_m: Sequence[float]) -> Array:
    """Return azimuth and elevation of each lamp, n x 2."""
    sights = lamps_m - np.array(eyes_m)
    level = np.hypot(sights[:, 0], sights[:, 1])
    azimuths = np.arctan2(sights[:, 1], sights[:, 0])
    elevations = np.arctan2(sights[:, 2], level)
    return np.stack([azimuths, elevations], axis=1)


def room_of_lamps(rng: np.random.Generator) -> Array:
    """Return places of lamps 2 to 4.5 m away in a sector of 140°, none nearly in front of another."""
    lamps: list[list[float]] = []
    while len(lamps) < LAMPS:
        azimuth = math.radians(float(rng.uniform(-70.0, 70.0)))
        distance_m = float(rng.uniform(2.0, 4.5))
        height_m = float(rng.uniform(0.5, 2.3))
        x_m = distance_m * math.cos(azimuth)
        y_m = distance_m * math.sin(azimuth)
        lamp = [x_m, y_m, height_m]
        seen = angles(np.array([*lamps, lamp]), (0.0, 0.0, EYES_M))
        aside_rad = [np.hypot(*(other - seen[-1])) for other in seen[:-1]]
        if all(angle > MIN_APART_RAD for angle in aside_rad):
            lamps.append(lamp)
    return np.array(lamps)


def run(seed: int, skill: float | None) -> PlacesResult:
    """Return the result of one person in one room; `skill` as of `user-sim`, None: random."""
    # the person, the IMU and the way to the second place, drawn in this order
    rng = np.random.default_rng(seed)
    if skill is None:
        skill = float(rng.random())
    lamps_m = room_of_lamps(rng)
    error = OpenLoopError(AimConfig(), skill, rng)
    drift_degps = WristbandConfig().yaw_rate_bias_sd_degps * float(rng.standard_normal())
    drift_radps = math.radians(drift_degps)
    eyes_m = _drawn(EYES_M, EYES_SIGMA_M, rng)
    walk_m = _drawn(WALK_M, WALK_SIGMA_M, rng)
    walk_rad = _drawn(math.pi / 2.0, WALK_AZIMUTH_SIGMA_RAD, rng)
    second_m = (walk_m * math.cos(walk_rad), walk_m * math.sin(walk_rad))

    presses = _Presses(lamps_m, second_m, eyes_m, error, drift_radps)
    while presses.progress.state.step == "place":
        presses.go_on()
    placed_lamps = presses.progress.state.placed
    placed = {_index_of(lamp.lamp): lamp.position_m for lamp in placed_lamps}
    origin_m = presses.progress.state.places_m[1]
    result = judged(placed, origin_m, lamps_m[sorted(placed)], second_m, eyes_m, error, rng)
    result.presses = presses.count
    result.left_out = len(lamps_m) - len(placed)
    return result


class _Presses:
    """Presses of one person while their yaw drifts.

    The cards of `pointit home` say which lamp comes next, and when to walk.
    """

    def __init__(
        self,
        lamps_m: Array,
        second_m: tuple[float, float],
        eyes_m: float,
        error: OpenLoopError,
        drift_radps: float,
    ) -> None:
        self.count = 0
        lamps = tuple(ChosenLamp(id=f"light.{index}") for index in range(len(lamps_m)))
        self.progress = SetupProgress()
        self.progress.choose(lamps, ())
        self.progress.take_hand("phone", "person")
        self._lamps_m = lamps_m
        self._second_m = second_m
        self._eyes_m = eyes_m
        self._error = error
        self._drift_radps = drift_radps
        self._place_m = (0.0, 0.0)
        self._time_s = 0.0
        self._previous = np.zeros(2)
        """Direction of the last lamp; the first one of a place is reached from ahead."""

    def go_on(self) -> None:
        """Walk if the cards allow it, or else press at the lamp of which it is the turn."""
        if self.progress.may_walk:
            self.progress.walk()
            self._place_m = self._second_m
            self._time_s += WALK_S
            self._previous = np.zeros(2)
        elif self.progress.target is None:
            self.progress.on_room(self.progress.fit())
        else:
            self._press(_index_of(self.progress.target[0]))

    def _press(self, lamp: int) -> None:
        seen = angles(self._lamps_m, (*self._place_m, self._eyes_m))[lamp]
        aim = _aim(self._error, seen, self._previous)
        azimuth = float(aim[0]) + self._drift_radps * self._time_s
        self.progress.press(azimuth, float(aim[1]), EYES_M)
        self._previous = seen
        self.count += 1
        self._time_s += SECONDS_A_PRESS


def _index_of(lamp: str) -> int:
    return int(lamp.partition(".")[2])


def _drawn(mean: float, sigma: float, rng: np.random.Generator) -> float:
    return mean + sigma * float(rng.standard_normal())


def _aim(error: OpenLoopError, lamp: Array, previous: Array) -> Array:
    """Return azimuth and elevation of an arm that reached from `previous` for `lamp` (2 each)."""
    amplitude = np.hypot(*(lamp - previous))
    error.draw(float(amplitude))
    return lamp + np.array(error.now_rad)


def judged(  # noqa: PLR0917 - the truth, and what is known of it
    placed_m: dict[int, Vec3],
    mapped_second: tuple[float, float],
    lamps_m: Array,
    second_m: tuple[float, float],
    eyes_m: float,
    error: OpenLoopError,
    rng: np.random.Generator,
) -> PlacesResult:
    """Return errors and selections in the map `placed_m` of the lamps at `lamps_m`, in the same order."""
    result = PlacesResult(errors_deg=[])
    mapped_m = np.array([placed_m[index] for index in sorted(placed_m)])
    mapped_second_m = np.array(mapped_second)
    # people point with their bias later, too
    bias = np.array([0.0, error.bias_rad])
    for share in (0.0, 1.0, 0.5):
        x_m = share * second_m[0]
        y_m = share * second_m[1]
        seen = angles(lamps_m, (x_m, y_m, eyes_m))
        mapped_place_m = share * mapped_second_m
        mapped = angles(mapped_m, (*mapped_place_m, EYES_M))

        # errors of directions, once the heading is found again by pointing at a lamp
        off = mapped - seen - bias
        off[:, 0] = _wrapped(off[:, 0])
        heading = float(np.median(off[:, 0]))
        off[:, 0] -= heading
        sideways = off[:, 0] * np.cos(seen[:, 1])
        errors_deg = np.degrees(np.hypot(sideways, off[:, 1]))
        result.errors_deg.append(errors_deg.tolist())
        _select(result, seen + np.array([heading, 0.0]), mapped, error, rng)
    return result


def _wrapped(angles_rad: Array) -> Array:
    """Return angles from -π to π."""
    return np.remainder(angles_rad + math.pi, math.tau) - math.pi


def _select(
    result: PlacesResult, seen: Array, mapped: Array, error: OpenLoopError, rng: np.random.Generator
) -> None:
    """Select each lamp: the person presses when they hear or see that theirs is meant."""
    for index, lamp in enumerate(seen):
        aim = _aim(error, lamp, seen[index - 1])
        result.tries += 1
        for _ in range(MAX_CORRECTIONS + 1):
            away = np.hypot(*(mapped - aim).T)
            meant = int(np.argmin(away))
            is_lapse = float(rng.random()) < DecisionConfig().lapse_share
            is_captured = away[meant] <= CAPTURE_RAD
            is_confirmed = meant == index or is_lapse
            if is_captured and is_confirmed:
                result.confirmed += meant == index
                result.wrong += meant != index
                break
            # the name of another lamp says which way to go, silence lets them look for the lamp's own light
            if is_captured:
                step = lamp - seen[meant]
            else:
                step = mapped[index] - aim
            aim = aim + step + CORRECTED_SIGMA_RAD * rng.standard_normal(2)


def _shown_errors(errors_deg: Sequence[Sequence[float]]) -> str:
    """Return median and 90 % of the errors of all people, with intervals of 95 % over the people."""
    rng = np.random.default_rng(1)
    percentiles: list[Array] = []
    for _ in range(RESAMPLINGS):
        people = rng.integers(0, len(errors_deg), len(errors_deg))
        sample = np.concatenate([errors_deg[person] for person in people])
        percentiles.append(np.percentile(sample, (50, 90)))
    low, high = np.percentile(percentiles, (2.5, 97.5), axis=0)
    median, most = np.percentile(np.concatenate(errors_deg), (50, 90))
    return f"{median:.1f}° ({low[0]:.1f} to {high[0]:.1f}), 90 % {most:.1f}° ({low[1]:.1f} to {high[1]:.1f})"


def main() -> None:
    """Print the figures for random people, and for those without any practice."""
    for name, skill in (("random skill", None), ("no practice", 0.0)):
        results = [run(seed, skill) for seed in SEEDS]
        presses = float(np.mean([result.presses for result in results]))
        left_out = sum(result.left_out for result in results)
        tries = sum(result.tries for result in results)
        confirmed = sum(result.confirmed for result in results)
        wrong = sum(result.wrong for result in results)
        right = 100.0 * confirmed / max(confirmed + wrong, 1)

        # errors of all lamps and people, by place
        parts: list[str] = []
        for index, place in enumerate(("A", "B", "between")):
            parts.append(f"{place} {_shown_errors([result.errors_deg[index] for result in results])}")
        sys.stdout.write(
            f"{name}: {len(results)} people, {LAMPS} lamps, {presses:.1f} presses each, {left_out} left "
            f"out: {', '.join(parts)}; {tries} selections, "
            f"{confirmed} right, {wrong} acts on another lamp, {right:.1f} % of the confirmed right\n"
        )


if __name__ == "__main__":
    main()
