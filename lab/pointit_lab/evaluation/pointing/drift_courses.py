"""Recorded runs as sequences of holds with their yaw, and chains of a person's runs."""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from pointit.geometry import rotation, vector
from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift.rest_detection import RestDetector, RestYawRate
from pointit_lab.evaluation.datasets.proximity_feedback import FloorTrial

EYE_M = 1.64
"""Assumed height of the eyes: it was not recorded, and azimuths hardly depend on it."""

MAD_TO_SIGMA = 1.4826

MAX_CHAINED = 4
"""Runs of one person that are chained; four have 24 orders."""


@dataclass(frozen=True, kw_only=True)
class CourseHold:
    """A person points steadily at a known position without a cursor."""

    at_s: float
    target_m: Vec3
    direction_h: Vec3
    """Mean of the rays, unit."""
    spread_rad: float
    rest: RestYawRate | None
    """Result of `RestDetector`, with the time of the hold."""

    @property
    def yaw_rad(self) -> float:
        """Return the yaw of {H}, for a person at 0."""
        return vector.azimuth(self.target_m) - vector.azimuth(self.direction_h)

    def turned(self, yaw_rad: float, later_s: float) -> "CourseHold":
        """Return this hold, later and with an IMU whose yaw origin was turned by `yaw_rad` in {W}."""
        rest = self.rest
        if rest is not None:
            later_ns = round(later_s * NS_PER_S)
            rest = replace(rest, stamp_ns=rest.stamp_ns + later_ns)
        direction_h = vector.rotate_z(self.direction_h, -yaw_rad)
        return replace(self, at_s=self.at_s + later_s, direction_h=direction_h, rest=rest)


@dataclass(frozen=True, kw_only=True)
class HoldSequence:
    """Holds with a common heading reference, set by the first one."""

    subject: str
    holds: tuple[CourseHold, ...]

    def nearest(self, at_s: float) -> int:
        """Return the index of the hold nearest to `at_s` after the first one."""
        start_s = self.holds[0].at_s
        distances_s = [abs(hold.at_s - start_s - at_s) for hold in self.holds]
        return distances_s.index(min(distances_s))


def courses(trials: Sequence[FloorTrial]) -> list[HoldSequence]:
    """Return the runs: the heading was measured again whenever the first target was repeated."""
    runs: list[HoldSequence] = []
    holds: list[CourseHold] = []
    seen: set[str] = set()
    subject = ""
    for trial in trials:
        is_new_run = trial.subject != subject or trial.target_id in seen
        if is_new_run:
            if holds:
                runs.append(HoldSequence(subject=subject, holds=tuple(holds)))
            holds = []
            seen.clear()
            subject = trial.subject
        seen.add(trial.target_id)
        hold = _hold(trial)
        if hold is not None:
            holds.append(hold)
    if holds:
        runs.append(HoldSequence(subject=subject, holds=tuple(holds)))
    return runs


def chained(sequences: Iterable[HoldSequence]) -> Iterator[HoldSequence]:
    """Yield each person's runs joined in every order of the first `MAX_CHAINED`."""
    people = defaultdict[str, list[HoldSequence]](list)
    for run in sequences:
        people[run.subject].append(run)
    for own_runs in people.values():
        for order in permutations(own_runs[:MAX_CHAINED]):
            yield _joined(order)


def _joined(sequences: Sequence[HoldSequence]) -> HoldSequence:
    chain = sequences[0]
    for run in sequences[1:]:
        last = chain.holds[-1]
        first = run.holds[0]
        # its first hold falls on the last one before
        turn = last.yaw_rad - first.yaw_rad
        later_s = last.at_s - first.at_s
        later_holds = tuple(hold.turned(turn, later_s) for hold in run.holds[1:])
        chain = replace(chain, holds=chain.holds + later_holds)
    return chain


def hold_sigma_rad(sequences: Sequence[HoldSequence]) -> float:
    """Return one sigma of a hold's azimuth, from the deviation of three in a row from a constant rate."""
    beside: list[float] = []
    for run in sequences:
        for first, middle, last in zip(run.holds, run.holds[1:], run.holds[2:], strict=False):
            share = (middle.at_s - first.at_s) / (last.at_s - first.at_s)
            step = math.remainder(middle.yaw_rad - first.yaw_rad, math.tau)
            whole = math.remainder(last.yaw_rad - first.yaw_rad, math.tau)
            bend = step - share * whole
            # standard deviation of the bend of three independent errors, of one sigma each
            variance = 1.0 + share**2 + (1.0 - share) ** 2
            beside.append(bend / math.sqrt(variance))
    if not beside:
        return 0.0
    median = float(np.median(np.abs(beside)))
    return MAD_TO_SIGMA * median


def _hold(trial: FloorTrial) -> CourseHold | None:
    """Return the trial's hold without a cursor, or None if it was not recorded."""
    stretch = trial.phases.get("open_loop_hold")
    if stretch is None:
        return None
    if len(stretch.times_s) < 10:
        return None
    x_m = stretch.points_m[:, 0]
    y_m = stretch.points_m[:, 1]
    azimuths = np.unwrap(np.arctan2(y_m, x_m))
    elevations = np.arctan2(-EYE_M, np.hypot(x_m, y_m))
    # the middle of the hold, whatever single samples do
    azimuth = float(np.median(azimuths))
    elevation = float(np.median(elevations))
    sideways = (azimuths - azimuth) * math.cos(elevation)
    about = np.hypot(sideways, elevations - elevation)
    return CourseHold(
        at_s=float(np.mean(stretch.times_s[[0, -1]])),
        target_m=(*trial.target_m, 0.0),
        direction_h=vector.direction(azimuth, elevation),
        spread_rad=float(np.median(about)),
        rest=_first_rest(azimuths, elevations, stretch.times_s),
    )


def _first_rest(azimuths: Array, elevations: Array, times_s: Array) -> RestYawRate | None:
    """Return the first rest in a hold, which shows the drift of the yaw within it, or None."""
    detector = RestDetector()
    samples = zip(azimuths.tolist(), elevations.tolist(), times_s.tolist(), strict=True)
    rests: list[RestYawRate | None] = []
    for azimuth, elevation, time_s in samples:
        orientation = rotation.from_azimuth_elevation(azimuth, elevation)
        rests.append(detector.add(orientation, round(time_s * NS_PER_S)))
    rests.append(detector.end())
    for rest in rests:
        if rest is not None:
            return rest
    return None
