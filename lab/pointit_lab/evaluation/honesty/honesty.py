"""The table of honesty: stated uncertainties of taken poses, by set and condition (issue: accuracy II)."""

import math
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution
from pointit.services.localizer.estimation.solution import right_share
from pointit_lab.evaluation.honesty import simulated_people
from pointit_lab.evaluation.honesty.injections import INJECTIONS, Injection
from pointit_lab.evaluation.honesty.row import MEDIAN_SQUARE, UNIT_S, WITHIN_SQUARE, Judged
from pointit_lab.evaluation.honesty.sources import SIMULATED, Size, people
from pointit_lab.evaluation.localization.localization import judged
from pointit_lab.evaluation.localization.trial import FollowRecording, LocalizationTrial
from pointit_lab.evaluation.recordings.parallel import map_in_order

WINDOWS_S = (2.0, 3.0, 5.0, 10.0)
"""Durations of following."""

MAX_DRAWN = 12
"""Largest number of times that simulated people are drawn: some conditions have hardly a taken pose."""

CHUNK = 8
"""Sources in one piece of work."""

COUNTS = (3, 4, 6)
"""Numbers of lamps."""

PAUSE_S = 2.0
"""Pause between two holds."""

WALL_M = 0.01
"""Difference of the x of lamps on one wall."""


@dataclass(frozen=True, kw_only=True)
class PeopleSource:
    """One person, and what is done with them."""

    injection: Injection
    number: int
    """Index of the recording, or of the pass through a room, in its set."""
    followed: FollowRecording | None = None
    room: LocalizationTrial | None = None
    most: int | None = None
    """Largest number of windows of each duration, evenly taken. None if all are."""

    @property
    def key(self) -> tuple[str, str]:
        """Return the set of the person and the condition."""
        person = self.followed or self.room
        name = "" if person is None else person.set
        return name, self.injection.name


def sources_of(
    followed: Sequence[FollowRecording],
    trials: Sequence[LocalizationTrial],
    injections: Iterable[Injection] = INJECTIONS,
    max_trials: int | None = None,
) -> list[PeopleSource]:
    """Return the work: each person under each condition that fits, set by set.

    Args:
        followed: people who follow a robot.
        trials: people who have pointed at each lamp of a room.
        injections: conditions.
        max_trials: maximum windows of each recording and duration, one of simulated people. None: all.
    """
    conditions = list(injections)
    sources: list[PeopleSource] = []
    names = [recording.set for recording in followed]
    names += [trial.set for trial in trials]
    for name in dict.fromkeys(names):
        # another person tells more than another window
        windows = 1 if name == simulated_people.SET else max_trials
        own_recordings = [recording for recording in followed if recording.set == name]
        own_rooms = [trial for trial in trials if trial.set == name]

        # not every condition fits both: some change only robots, others only lamps
        for injection in conditions:
            if injection.follows:
                for number, recording in enumerate(own_recordings):
                    source = PeopleSource(
                        injection=injection, number=number, followed=recording, most=windows
                    )
                    sources.append(source)
            if injection.points:
                for number, room in enumerate(own_rooms):
                    sources.append(PeopleSource(injection=injection, number=number, room=room))
    return sources


def drawn_again(
    judged: Sequence[Judged],
    injections: Sequence[Injection],
    size: Size,
    seed: int,
    *,
    jobs: int,
    tick: Callable[[int, int], None],
) -> list[Judged]:
    """Return `judged` and those of further simulated people, as many as rows need.

    A row needs `size.taken` people with a taken pose. It ends with `MAX_DRAWN` times the people of `size`.

    Args:
        judged: those of people from `seed` on.
        injections: conditions.
        size: amount of trials.
        seed: of the first simulated person.
        jobs: number of processes.
        tick: called with the number of finished sources and of all.

    Raises:
        PointItError: If a process ended unexpectedly.
    """
    verdicts = list(judged)
    for turn in range(1, MAX_DRAWN):
        short = _short_rows(verdicts, size.taken)
        if not short:
            break

        # new people, judged only under the conditions that need more of them
        names = {name for name, _ in short}
        turn_seed = seed + turn * size.people
        drawn = people(None, sorted(names), size, turn_seed)
        drawn_sources = sources_of(drawn.followed, drawn.rooms, injections)
        sources = [source for source in drawn_sources if source.key in short]
        verdicts += judged_sources(sources, jobs=jobs, tick=tick)
    return verdicts


def _short_rows(verdicts: Iterable[Judged], people: int) -> set[tuple[str, str]]:
    """Return set and condition of simulated rows in which fewer than `people` have a taken pose."""
    # a row without any taken pose is short, too: it needs its empty set
    taken = defaultdict[tuple[str, str], set[str]](set)
    for verdict in verdicts:
        if verdict.set not in SIMULATED:
            continue
        subjects = taken[verdict.set, verdict.condition]
        if verdict.taken:
            subjects.add(verdict.subject)
    return {key for key, subjects in taken.items() if len(subjects) < people}


def judged_sources(
    sources: Sequence[PeopleSource], *, jobs: int, tick: Callable[[int, int], None]
) -> list[Judged]:
    """Return the verdicts on `sources`.

    Args:
        sources: see `sources_of`.
        jobs: number of processes.
        tick: called with the number of finished sources and of all.

    Raises:
        PointItError: If a process ended unexpectedly.
    """
    by_source = map_in_order(judge_source, sources, jobs=jobs, chunk=CHUNK, tick=tick)
    return list(chain.from_iterable(by_source))


def judge_source(source: PeopleSource) -> list[Judged]:
    """Return the verdicts on all trials of `source`. Runs in other processes."""
    condition = source.injection.name
    return [verdict(trial, condition) for trial in trials_of(source)]


def trials_of(source: PeopleSource) -> Iterator[LocalizationTrial]:
    """Yield the trials of `source` under its condition, the same ones in each run."""
    injection = source.injection
    for number, trial in enumerate(_plain(source)):
        if injection.change is None:
            yield trial
            continue
        text = f"{trial.set} {trial.subject} {injection.name}"
        seed = zlib.crc32(text.encode())
        rng = np.random.default_rng([seed, source.number, number])
        yield injection.change(trial, rng)


def _plain(source: PeopleSource) -> Iterator[LocalizationTrial]:
    injection = source.injection
    if source.followed is not None:
        recording = source.followed
        if injection.shift_s:
            recording = recording.shifted(injection.shift_s)
        for window_s in WINDOWS_S:
            trials = list(recording.trials((window_s,)))
            step = 1
            if source.most is not None:
                per_window = math.ceil(len(trials) / source.most)
                step = max(1, per_window)
            yield from trials[::step]
    if source.room is not None:
        seed = zlib.crc32(source.room.subject.encode())
        rng = np.random.default_rng([seed, source.number])
        for count in COUNTS:
            yield chosen(source.room, count, rng, injection)


def verdict(trial: LocalizationTrial, condition: str) -> Judged:
    """Return the verdict on the pose of `trial`: if the localizer takes it, and if its uncertainty holds."""
    pose = judged(trial.pointings)
    # windows of a recording overlap: stretches of it count as independent. Simulated people are independent
    unit = ""
    if trial.recording and trial.set not in SIMULATED:
        unit = f"{trial.recording} {trial.start_s // UNIT_S}"
    refused = Judged(
        set=trial.set,
        condition=condition,
        duration=trial.condition,
        subject=trial.subject,
        unit=unit,
        taken=False,
    )
    if isinstance(pose, Refusal):
        return refused

    # the place, against its stated covariance (Mahalanobis)
    off_m = np.array([pose.x_m - trial.x_m, pose.y_m - trial.y_m])
    place_covariance = pose.covariance[:2, :2]
    weighted = np.linalg.solve(place_covariance, off_m)
    square = float(off_m @ weighted)
    taken = replace(
        refused,
        taken=True,
        error_m=float(np.hypot(*off_m)),
        square=square / MEDIAN_SQUARE,
        in_place=square <= WITHIN_SQUARE,
    )
    if trial.yaw_rad is None:
        return taken

    # what needs the true yaw
    turned_rad = math.remainder(pose.yaw_rad - trial.yaw_rad, math.tau)
    offset = -complex(*off_m)
    return replace(
        taken,
        in_yaw=abs(turned_rad) <= 2.0 * pose.yaw_sigma_rad,
        miss_m=_miss_m(trial, off_m, turned_rad),
        miss_sigma_m=_stated_miss_m(trial, pose),
        right=right_share(np.array([offset]), np.array([-turned_rad])),
    )


def _miss_m(trial: LocalizationTrial, off_m: Array, turned_rad: float) -> float:
    """Return the rms miss of cursors at the targets of `trial` by a pose that is off and turned."""
    targets_m = trial.pointings.targets_m[:, :2] - (trial.x_m, trial.y_m)
    east, north = targets_m.T
    # less 1: displacement by the rotation, not the rotated target
    cosine = math.cos(turned_rad) - 1.0
    sine = math.sin(turned_rad)
    miss_east: Array = off_m[0] + cosine * east - sine * north
    miss_north: Array = off_m[1] + sine * east + cosine * north
    squares: Array = miss_east**2 + miss_north**2
    return math.sqrt(float(np.mean(squares)))


def _stated_miss_m(trial: LocalizationTrial, solution: Solution) -> float:
    """Return the rms miss of cursors at the targets of `trial` by the covariance of the pose `solution`."""
    targets_m = trial.pointings.targets_m[:, :2] - (solution.x_m, solution.y_m)
    east, north = targets_m.T
    (xx, _, x_turn), (_, yy, y_turn), (_, _, turn) = solution.covariance.tolist()
    distance_squares: Array = east**2 + north**2
    cross_terms: Array = east * y_turn - north * x_turn
    squares: Array = xx + yy + distance_squares * turn + 2.0 * cross_terms
    mean_square = float(np.mean(squares))
    # rounding can make it negative
    return math.sqrt(max(0.0, mean_square))


def chosen(
    trial: LocalizationTrial, count: int, rng: np.random.Generator, injection: Injection = INJECTIONS[0]
) -> LocalizationTrial:
    """Return the pointing at `count` random lamps of `trial`, one hold after the other.

    Args:
        trial: a hold at each of more than `count` lamps.
        count: number of lamps.
        rng: for the choice.
        injection: `wrong_lamp` if the person pointed at another lamp than one that was lit, which was not lit
            otherwise; `one_wall` to choose lamps of equal x; `visits` of each lamp.
    """
    pointings = trial.pointings
    holds = _holds(pointings)
    lamps_m = np.array([pointings.targets_m[hold[0]] for hold in holds])
    candidates: NDArray[np.intp] = np.arange(len(holds))
    if injection.one_wall:
        candidates = _lamps_of_a_wall(lamps_m, count, rng)

    # one more for the wrong lamp, which is lit instead of one that is pointed at
    drawn = count + injection.wrong_lamp
    order: list[int] = rng.choice(candidates, size=drawn, replace=False).tolist()
    pointed = order[:count]
    lit_m = lamps_m[pointed].copy()
    if injection.wrong_lamp:
        wrong = rng.integers(count)
        lit_m[wrong] = lamps_m[order[-1]]
    lit_m = np.tile(lit_m, (injection.visits, 1))
    chosen_holds = [holds[index] for index in pointed] * injection.visits

    # one after the other
    stamps_s = _successive_stamps_s([pointings.stamps_s[hold] for hold in chosen_holds])
    rows = np.concatenate(chosen_holds)
    targets_m = np.repeat(lit_m, [len(hold) for hold in chosen_holds], axis=0)
    chosen_pointings = Pointings(stamps_s, pointings.origins_m[rows], pointings.directions[rows], targets_m)
    return replace(trial, condition=f"{count} lamps", pointings=chosen_pointings)


def _successive_stamps_s(stamps_s: Iterable[Array]) -> Array:
    """Return the times of holds that follow each other with a pause, the first at 0."""
    successive_s: list[Array] = []
    start_s = 0.0
    for own_s in stamps_s:
        shifted_s = own_s - own_s[0] + start_s
        successive_s.append(shifted_s)
        start_s = float(shifted_s[-1]) + PAUSE_S
    return np.concatenate(successive_s)


def _holds(pointings: Pointings) -> list[NDArray[np.intp]]:
    """Return the rows of each hold, which ends where the target changes."""
    steps_m = np.diff(pointings.targets_m, axis=0)
    is_changed = np.any(steps_m != 0.0, axis=1)
    rows = np.arange(len(pointings))
    changes = np.flatnonzero(is_changed) + 1
    return np.split(rows, changes)


def _lamps_of_a_wall(lamps_m: Array, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return the indices of the lamps on a random wall that has at least `count`.

    A wall is as probable as it has lamps.
    """
    x_m = lamps_m[:, 0]
    walls: list[NDArray[np.intp]] = []
    for wall_x_m in x_m.tolist():
        is_near = np.abs(x_m - wall_x_m) < WALL_M
        wall = np.flatnonzero(is_near)
        if len(wall) >= count:
            walls.append(wall)
    return walls[int(rng.integers(len(walls)))]
