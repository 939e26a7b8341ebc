"""The table of honesty: stated uncertainties of taken poses, by set and condition (issue: accuracy II)."""

import math
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

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
        return "" if person is None else person.set, self.injection.name


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
    for name in dict.fromkeys([*(each.set for each in followed), *(each.set for each in trials)]):
        windows = (
            1 if name == simulated_people.SET else max_trials
        )  # another person tells more than another window
        for injection in conditions:
            if injection.follows:
                sources += [
                    PeopleSource(injection=injection, number=number, followed=each, most=windows)
                    for number, each in enumerate(each for each in followed if each.set == name)
                ]
            if injection.points:
                sources += [
                    PeopleSource(injection=injection, number=number, room=each)
                    for number, each in enumerate(each for each in trials if each.set == name)
                ]
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
    found = list(judged)
    for turn in range(1, MAX_DRAWN):
        taken: dict[tuple[str, str], set[str]] = {
            (each.set, each.condition): set() for each in found if each.set in SIMULATED
        }
        for each in found:
            if each.taken and each.set in SIMULATED:
                taken[each.set, each.condition].add(each.subject)
        short = {key for key, subjects in taken.items() if len(subjects) < size.taken}
        if not short:
            break
        drawn = people(None, sorted({name for name, _ in short}), size, seed + turn * size.people)
        sources = [each for each in sources_of(drawn.followed, drawn.rooms, injections) if each.key in short]
        found += judged_sources(sources, jobs=jobs, tick=tick)
    return found


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
    verdicts = map_in_order(judge_source, sources, jobs=jobs, chunk=CHUNK, tick=tick)
    return [each for of_source in verdicts for each in of_source]


def judge_source(source: PeopleSource) -> list[Judged]:
    """Return the verdicts on all trials of `source`. Runs in other processes."""
    return [verdict(trial, source.injection.name) for trial in trials_of(source)]


def trials_of(source: PeopleSource) -> Iterator[LocalizationTrial]:
    """Yield the trials of `source` under its condition, the same ones in each run."""
    injection = source.injection
    for number, trial in enumerate(_plain(source)):
        seed = zlib.crc32(f"{trial.set} {trial.subject} {injection.name}".encode())
        rng = np.random.default_rng([seed, source.number, number])
        yield trial if injection.change is None else injection.change(trial, rng)


def _plain(source: PeopleSource) -> Iterator[LocalizationTrial]:
    injection = source.injection
    if source.followed is not None:
        recording = source.followed
        recording = recording.shifted(injection.shift_s) if injection.shift_s else recording
        for window_s in WINDOWS_S:
            trials = list(recording.trials((window_s,)))
            step = 1 if source.most is None else max(1, math.ceil(len(trials) / source.most))
            yield from trials[::step]
    if source.room is not None:
        rng = np.random.default_rng([zlib.crc32(source.room.subject.encode()), source.number])
        for count in COUNTS:
            yield chosen(source.room, count, rng, injection)


def verdict(trial: LocalizationTrial, condition: str) -> Judged:
    """Return the verdict on the pose of `trial`: if the localizer takes it, and if its uncertainty holds."""
    found = judged(trial.pointings)
    one = Judged(
        set=trial.set,
        condition=condition,
        duration=trial.condition,
        subject=trial.subject,
        unit=f"{trial.recording} {trial.start_s // UNIT_S}"
        if trial.set not in SIMULATED and trial.recording
        else "",
        taken=False,
    )
    if isinstance(found, Refusal):
        return one
    off = np.array([found.x_m - trial.x_m, found.y_m - trial.y_m])
    error_m = float(np.hypot(*off))
    in_yaw = miss_m = right = None
    if trial.yaw_rad is not None:
        turned_rad = math.remainder(found.yaw_rad - trial.yaw_rad, math.tau)
        in_yaw = abs(turned_rad) <= 2.0 * found.yaw_sigma_rad
        miss_m = _miss_m(trial, off, turned_rad)
        right = right_share(np.array([-complex(*off)]), np.array([-turned_rad]))
    square = float(off @ np.linalg.solve(found.covariance[:2, :2], off))
    return replace(
        one,
        taken=True,
        error_m=error_m,
        square=square / MEDIAN_SQUARE,
        in_place=square <= WITHIN_SQUARE,
        in_yaw=in_yaw,
        miss_m=miss_m,
        right=right,
        miss_sigma_m=None if miss_m is None else _stated_miss_m(trial, found),
    )


def _miss_m(trial: LocalizationTrial, off_m: Array, turned_rad: float) -> float:
    """Return the rms miss of cursors at the targets of `trial` by a pose that is off and turned."""
    east, north = (trial.pointings.targets_m[:, :2] - (trial.x_m, trial.y_m)).T
    cosine = math.cos(turned_rad) - 1.0
    sine = math.sin(turned_rad)
    squares: Array = (off_m[0] + cosine * east - sine * north) ** 2 + (
        off_m[1] + sine * east + cosine * north
    ) ** 2
    return math.sqrt(float(np.mean(squares)))


def _stated_miss_m(trial: LocalizationTrial, solution: Solution) -> float:
    """Return the rms miss of cursors at the targets of `trial` by the covariance of the pose `solution`."""
    east, north = (trial.pointings.targets_m[:, :2] - (solution.x_m, solution.y_m)).T
    (xx, _, x_turn), (_, yy, y_turn), (_, _, turn) = solution.covariance.tolist()
    squares: Array = xx + yy + (east**2 + north**2) * turn + 2.0 * (east * y_turn - north * x_turn)
    return math.sqrt(max(0.0, float(np.mean(squares))))


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
    starts = np.append(True, np.any(np.diff(pointings.targets_m, axis=0) != 0.0, axis=1))
    holds: list[NDArray[np.intp]] = np.split(np.arange(len(pointings)), np.flatnonzero(starts)[1:])
    lamps_m = pointings.targets_m[np.flatnonzero(starts)]
    among: NDArray[np.intp] = np.arange(len(holds))
    if injection.one_wall:
        walls = [np.flatnonzero(np.abs(lamps_m[:, 0] - x_m) < WALL_M) for x_m in lamps_m[:, 0].tolist()]
        walls = [wall for wall in walls if len(wall) >= count]
        among = walls[int(rng.integers(len(walls)))]
    order: list[int] = rng.choice(among, size=count + injection.wrong_lamp, replace=False).tolist()
    pointed = order[:count]
    lit_m = lamps_m[pointed].copy()
    if injection.wrong_lamp:
        lit_m[rng.integers(count)] = lamps_m[order[-1]]
    stamps_s: list[Array] = []
    began_s = 0.0
    pointed = pointed * injection.visits
    lit_m = np.tile(lit_m, (injection.visits, 1))
    for index in pointed:
        stamps_s.append(pointings.stamps_s[holds[index]] - pointings.stamps_s[holds[index][0]] + began_s)
        began_s = float(stamps_s[-1][-1]) + PAUSE_S
    held = [holds[index] for index in pointed]
    rows = np.concatenate(held)
    targets_m = np.repeat(lit_m, [len(each) for each in held], axis=0)
    return replace(
        trial,
        condition=f"{count} lamps",
        pointings=Pointings(
            np.concatenate(stamps_s), pointings.origins_m[rows], pointings.directions[rows], targets_m
        ),
    )
