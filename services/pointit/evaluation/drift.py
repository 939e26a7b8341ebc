"""How far the yaw is off while the IMU drifts and the person points at a known place once in a while.

Recorded: `proximity_feedback`. Its people point at three places in turn, one every 45 s, and their heading
was taken anew before each such run. Only holds without a cursor count, as anchors and as truth: the yaw that
a hold tells is the azimuth of its target less that of the ray, so that the person's own scatter is in every
error (row `scatter of one hold`). For longer times the runs of one person are chained in every order: the
next run goes on, in time and in yaw, where the last one ended, and what lay between them is left out; such
chains are not independent of each other. `3 min, 1 anchor/min` comes from such chains only, those of four
people who have three runs, in each order, so that its n counts chains and not people; its anchors are the
holds nearest to 0, 1 and 2 minutes, the last of them mostly 45 s before the hold that is told. The places
always came in the same order, so a compressed sense of azimuth would look like drift here; that the yaw moves
within single holds too speaks for drift.

Simulated: seeded people with a drifting IMU, whose true yaw is known.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import linregress

from pointit.evaluation.datasets import proximity_feedback
from pointit.evaluation.datasets.proximity_feedback import FloorTrial, read_floor_trials
from pointit.evaluation.drift_simulated import normal_row, simulated_rows
from pointit.evaluation.row import ALL, Row, Spread
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.localizer.drift import DriftFilter, DriftPose, DriftSettings, Fix
from pointit.services.localizer.stillness import Stillness, StillRate

Array = NDArray[np.float64]

EYE_M = 1.64
"""Assumed height of the eyes: the recordings do not tell it, and azimuths hardly depend on it."""

PLACE_SIGMA_M = 0.05
"""How exactly the recorded people stood where they should."""

PEOPLE = 300
MAD_TO_SIGMA = 1.4826

CHAINED = "3 min, 1 anchor/min"
"""Condition for which a person's runs are chained."""

CHAINS_REMARK = (
    f"`{CHAINED}` of {proximity_feedback.NAME}: the runs of each of four people chained in every order, n "
    "counts chains; the last anchor is mostly 45 s before the hold that is told."
)


@dataclass(frozen=True, kw_only=True)
class Hold:
    """Somebody points steadily at a known place without a cursor."""

    at_s: float
    target_m: Vec3
    direction_h: Vec3
    """Mean of the rays, unit."""
    spread_rad: float
    samples: int
    rate_radps: float
    """At which the yaw changes within the hold, by least squares."""
    rest: StillRate | None
    """What `Stillness` made of it, its time as the hold's."""

    @property
    def yaw_rad(self) -> float:
        """Return the yaw of {H} that it tells of somebody who stands at 0."""
        return vector.azimuth(self.target_m) - vector.azimuth(self.direction_h)

    def turned(self, yaw_rad: float, later_s: float) -> "Hold":
        """Return the same hold, later and with an IMU whose yaw origin was turned by `yaw_rad` in {W}."""
        moved = replace(self, at_s=self.at_s + later_s, direction_h=vector.turn(self.direction_h, -yaw_rad))
        if self.rest is None:
            return moved
        stamp_ns = self.rest.stamp_ns + round(later_s * NS_PER_S)
        return replace(moved, rest=replace(self.rest, stamp_ns=stamp_ns))


@dataclass(frozen=True, kw_only=True)
class Course:
    """Holds with one heading reference, the first of which sets the heading."""

    subject: str
    holds: tuple[Hold, ...]

    def nearest(self, at_s: float) -> int:
        """Return the number of the hold that is nearest to `at_s` after the first one."""
        start_s = self.holds[0].at_s
        return min(range(len(self.holds)), key=lambda i: abs(self.holds[i].at_s - start_s - at_s))


@dataclass(frozen=True)
class Guess:
    """What a solver says of a later hold's yaw."""

    yaw_rad: float
    sigma_rad: float | None = None


Solver = Callable[[Course, Sequence[int], int], Guess]
"""Course, holds that are anchors (the first hold among them, all before the last), hold to be told."""


def drift_rows(data: Path, tick: Callable[[str], None]) -> list[Row]:
    """Return what the yaw's error is after some time, recorded where the recordings are, and simulated.

    Args:
        data: holds one folder a set.
        tick: told what is being done, in a few words.

    Raises:
        ConfigError: a recording is damaged.
    """
    rows: list[Row] = []
    folder = data / proximity_feedback.NAME
    if folder.is_dir():
        tick("drift: reading recordings")
        rows += recorded_rows(read_floor_trials(folder), tick)
    tick(f"drift: {PEOPLE} simulated people")
    return rows + simulated_rows(PEOPLE)


def recorded_rows(trials: Sequence[FloorTrial], tick: Callable[[str], None]) -> list[Row]:
    """Return the rows of recorded people: within the runs, and with a person's runs chained."""
    runs = courses(trials)
    chains = list(chained(runs))
    sigma_rad = hold_sigma_rad(runs)
    rows: list[Row] = []
    for condition, some, anchors_s, told_s in (
        ("45 s, 1 anchor", runs, (0.0,), 45.0),
        ("90 s, 1 anchor", runs, (0.0,), 90.0),
        ("90 s, 2 anchors", runs, (0.0, 45.0), 90.0),
        (CHAINED, chains, (0.0, 60.0, 120.0), 180.0),
    ):
        tick(f"drift: {condition}")
        rows += _rows(condition, some, anchors_s, told_s, sigma_rad)
    return rows


def courses(trials: Sequence[FloorTrial]) -> list[Course]:
    """Return the runs: the heading was taken anew whenever the first target came again."""
    out: list[Course] = []
    held: list[Hold] = []
    seen: set[str] = set()
    subject = ""
    for trial in trials:
        if trial.subject != subject or trial.target_id in seen:
            if held:
                out.append(Course(subject=subject, holds=tuple(held)))
            held = []
            seen.clear()
            subject = trial.subject
        seen.add(trial.target_id)
        hold = _hold(trial)
        if hold is not None:
            held.append(hold)
    if held:
        out.append(Course(subject=subject, holds=tuple(held)))
    return out


MOST_CHAINED = 4
"""Runs of one person; their orders are 24, those of all would be endless."""


def chained(runs: Iterable[Course]) -> Iterator[Course]:
    """Return each person's runs as one, in every order of the first few: one goes on where another ended."""
    people: dict[str, list[Course]] = {}
    for run in runs:
        people.setdefault(run.subject, []).append(run)
    for mine in people.values():
        for order in permutations(mine[:MOST_CHAINED]):
            yield _joined(order)


def _joined(runs: Sequence[Course]) -> Course:
    chain = runs[0]
    for run in runs[1:]:
        last, first = chain.holds[-1], run.holds[0]
        turn, later_s = last.yaw_rad - first.yaw_rad, last.at_s - first.at_s
        chain = replace(chain, holds=chain.holds + tuple(h.turned(turn, later_s) for h in run.holds[1:]))
    return chain


def hold_sigma_rad(runs: Sequence[Course]) -> float:
    """Return one sigma of the azimuth of one hold, from what three in a row have beside a constant rate."""
    beside: list[float] = []
    for run in runs:
        for a, b, c in zip(run.holds, run.holds[1:], run.holds[2:], strict=False):
            share = (b.at_s - a.at_s) / (c.at_s - a.at_s)
            bend = _wrap(b.yaw_rad - a.yaw_rad) - share * _wrap(c.yaw_rad - a.yaw_rad)
            beside.append(bend / math.sqrt(1.0 + share**2 + (1.0 - share) ** 2))
    return MAD_TO_SIGMA * float(np.median(np.abs(beside))) if beside else 0.0


def _wrap(angle_rad: float) -> float:
    return math.remainder(angle_rad, math.tau)


def _hold(trial: FloorTrial) -> Hold | None:
    """Return the trial's hold without a cursor; none where it was not recorded."""
    stretch = trial.phases.get("open_loop_hold")
    if stretch is None or len(stretch.times_s) < 10:
        return None
    level = np.hypot(stretch.points_m[:, 0], stretch.points_m[:, 1])
    azimuths = np.unwrap(np.arctan2(stretch.points_m[:, 1], stretch.points_m[:, 0]))
    elevations = np.arctan2(-EYE_M, level)
    # the middle of the hold, whatever single samples do
    azimuth, elevation = float(np.median(azimuths)), float(np.median(elevations))
    rate = float(linregress(stretch.times_s, azimuths).slope)
    stillness = Stillness()
    rests = [
        stillness.add(rotation.from_azimuth_elevation(float(a), float(e)), round(float(t) * NS_PER_S))
        for a, e, t in zip(azimuths, elevations, stretch.times_s, strict=True)
    ]
    rests.append(stillness.end())
    about = np.hypot((azimuths - azimuth) * math.cos(elevation), elevations - elevation)
    return Hold(
        at_s=float(np.mean(stretch.times_s[[0, -1]])),
        target_m=(*trial.target_m, 0.0),
        direction_h=vector.direction(azimuth, elevation),
        spread_rad=float(np.median(about)),
        samples=len(azimuths),
        rate_radps=-rate,
        rest=next((rest for rest in rests if rest is not None), None),
    )


def _raw(course: Course, anchors: Sequence[int], told: int) -> Guess:
    del anchors, told
    return Guess(course.holds[0].yaw_rad)


def _re_anchored(course: Course, anchors: Sequence[int], told: int) -> Guess:
    del told
    return Guess(course.holds[anchors[-1]].yaw_rad)


def _rate_of_holds(course: Course, anchors: Sequence[int], told: int) -> Guess:
    last = course.holds[anchors[-1]]
    rate = float(np.mean([hold.rate_radps for hold in course.holds[:told]]))
    return Guess(last.yaw_rad + rate * (course.holds[told].at_s - last.at_s))


def _constant_rate(course: Course, anchors: Sequence[int], told: int) -> Guess:
    first, last = course.holds[0], course.holds[anchors[-1]]
    if first is last:
        return Guess(last.yaw_rad)
    rate = _wrap(last.yaw_rad - first.yaw_rad) / (last.at_s - first.at_s)
    return Guess(last.yaw_rad + rate * (course.holds[told].at_s - last.at_s))


def _filter(course: Course, anchors: Sequence[int], told: int) -> Guess:
    return _filtered(course, anchors, told, rests=False)


def _filter_and_rests(course: Course, anchors: Sequence[int], told: int) -> Guess:
    return _filtered(course, anchors, told, rests=True)


def _filtered(course: Course, anchors: Sequence[int], told: int, *, rests: bool) -> Guess:
    settings = DriftSettings()
    first = course.holds[0]
    level = math.cos(vector.elevation(first.direction_h))
    drift = DriftFilter(
        Fix(
            x_m=0.0,
            y_m=0.0,
            yaw_rad=first.yaw_rad,
            covariance=np.diag([PLACE_SIGMA_M, PLACE_SIGMA_M, settings.anchor_sigma_rad / level]) ** 2,
            stamp_ns=round(first.at_s * NS_PER_S),
        ),
        settings,
    )
    for number, hold in enumerate(course.holds[:told]):
        if number in anchors[1:]:
            drift.anchor(
                round(hold.at_s * NS_PER_S),
                hold.target_m,
                (0.0, 0.0, EYE_M),
                hold.direction_h,
                spread_rad=hold.spread_rad,
                samples=hold.samples,
            )
        rest = hold.rest
        if rests and rest is not None:
            drift.still(rest.stamp_ns, rest.yaw_rate_radps, rest.sigma_radps, rest.creep_sigma_radps)
    pose: DriftPose = drift.predict(round(course.holds[told].at_s * NS_PER_S))
    return Guess(pose.yaw_rad, pose.yaw_sigma_rad)


SOLVERS: dict[str, Solver] = {
    "raw": _raw,
    "re-anchored": _re_anchored,
    "re-anchored, rate of holds": _rate_of_holds,
    "re-anchored, constant rate": _constant_rate,
    "pointit": _filter,
    "pointit, rests": _filter_and_rests,
}
"""Who tells the yaw; `raw` sets it once at the start."""


def _rows(
    condition: str, some: Sequence[Course], anchors_s: Sequence[float], told_s: float, sigma_rad: float
) -> list[Row]:
    """Return a row for each person and solver, and those over all."""
    trials: list[tuple[Course, list[int], int]] = []
    for course in some:
        told = course.nearest(told_s)
        anchors = sorted({course.nearest(at_s) for at_s in anchors_s})
        away_s = course.holds[told].at_s - course.holds[0].at_s - told_s
        if anchors[-1] < told and abs(away_s) <= 0.25 * told_s:
            trials.append((course, anchors, told))
    rows: list[Row] = []
    for name, solver in SOLVERS.items():
        errors: list[tuple[str, float, float | None]] = []
        for course, anchors, told in trials:
            guess = solver(course, anchors, told)
            error = _wrap(guess.yaw_rad - course.holds[told].yaw_rad)
            errors.append((course.subject, error, guess.sigma_rad))
        for subject in (*dict.fromkeys(one[0] for one in errors), ALL):
            mine = [one for one in errors if subject in (one[0], ALL)]
            inside = [abs(e) <= 2.0 * math.hypot(s, sigma_rad) for _, e, s in mine if s is not None]
            rows.append(
                Row(
                    set=proximity_feedback.NAME,
                    subject=subject,
                    condition=condition,
                    solver=name,
                    n=len(mine),
                    yaw_deg=Spread.of(math.degrees(e) for _, e, _ in mine),
                    yaw_within_2_sigma=float(np.mean(inside)) if inside else None,
                )
            )
    if trials:
        rows.append(
            normal_row(proximity_feedback.NAME, condition, "scatter of one hold", len(trials), sigma_rad)
        )
    return rows
