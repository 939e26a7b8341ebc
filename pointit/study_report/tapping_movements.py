"""Throughput of tapping after ISO 9241-411: sequences, the comparable ones, and regressions of Fitts' law.

- ISO/TS 9241-411:2012, annex B. Soukoreff, R. W. and MacKenzie, I. S. (2004). Towards a standard for pointing
  device evaluation. Int. J. Human-Computer Studies 61, 751-789: effective width, mean of means.
- MacKenzie, I. S. (2015). Fitts' throughput and the remarkable case of touch-based target selection. HCI
  International, LNCS 9170, 238-249: the effective distance, and the calculation in two dimensions.
- Kopper, R., Bowman, D. A., Silva, M. G. and McMahan, R. P. (2010). A human motor behavior model for distal
  pointing tasks. Int. J. Human-Computer Studies 68, 603-615: angles, and an index that grows with the square.
- Lane, L., Lu, F., Davari, S., Teather, R. J. and Bowman, D. A. (2025). Revisiting performance models of
  distal pointing tasks in virtual reality. IEEE TVCG (arXiv 2505.03027): Fitts' index of angles fits best.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pointit.errors import ConfigError
from pointit.geometry.array_types import Array
from pointit.study.plan import MIN_SEQUENCE_TRIALS
from pointit.study_report.reading import SELECTED, TARGET, TrialRow, Trials
from pointit.study_report.table import Table, percentile_interval, resample_indices, summary

Unit = Literal["m", "deg"]
Index = Literal["m", "deg", "kopper"]
"""Index of difficulty: log2(D / W + 1) of metres or degrees, or that of Kopper et al. (2010) of degrees."""
Group = tuple[tuple[str, str], ...]
"""Levels by factor, without the factors that set the distance or the width, of which difficulty is made."""

WIDTHS_PER_SD = float(np.sqrt(2 * np.pi * np.e))
"""4.133: the width that 96 % of normally distributed selections hit, in standard deviations."""
KOPPER_EXPONENT = 3
"""k of Kopper et al. (2010), for angles in degrees."""
MAX_SIZE_RATIO = 1.05
"""Maximum ratio of distances, and of widths, that count as equal."""


class Movement(NamedTuple):
    """A trial that began at the known target of the trial before, in the same block."""

    trial: TrialRow
    distance_m: float
    """From target to target."""
    error_m: float
    """Along that line, positive beyond the target. NaN if nothing was selected."""
    before_m: float
    """Error with which the trial before ended, along its own line. NaN if not known."""
    size_m: tuple[float, float] = (0.0, 0.0)
    """Distance and width, where those that are nearly equal are the same."""
    group: Group = ()


def movements(trials: Trials) -> list[Movement]:
    """Return the movements of all counted trials with a width, a target and a target before, by condition."""
    results: list[Movement] = []
    error_m = np.nan
    for start, row in zip(trials.counted, trials.counted[1:], strict=False):
        before_m = error_m
        error_m = np.nan
        is_next = (start.participant, start.block) == (row.participant, row.block)
        if not is_next or not all(name in each.numbers for name in TARGET for each in (start, row)):
            continue
        target = _point(row, TARGET)
        line = target - _point(start, TARGET)
        distance_m = float(np.linalg.norm(line))
        if distance_m > 0 and row.numbers.get("target_width_m", 0) > 0:
            if all(name in row.numbers for name in SELECTED):
                error_m = float((_point(row, SELECTED) - target) @ line) / distance_m
            results.append(Movement(row, distance_m, error_m, before_m))
    results.sort(key=lambda each: trials.conditions.index(each.trial.levels))
    distances = _merged([each.distance_m for each in results])
    widths = _merged([each.trial.numbers["target_width_m"] for each in results])
    sizes = [(distances[each.distance_m], widths[each.trial.numbers["target_width_m"]]) for each in results]
    kept = [factor for factor in trials.factors if not _sets_size(trials.index(factor), results, sizes)]
    groups = (tuple((name, each.trial.levels[trials.index(name)]) for name in kept) for each in results)
    return [
        each._replace(size_m=size, group=group)
        for each, size, group in zip(results, sizes, groups, strict=True)
    ]


def _sets_size(factor: int, all_movements: Sequence[Movement], sizes: Sequence[tuple[float, float]]) -> bool:
    """Return True if each level of a factor has one distance of its own, or one width."""
    for part in (0, 1):
        by_level: dict[str, set[float]] = defaultdict(set)
        for each, size in zip(all_movements, sizes, strict=True):
            by_level[each.trial.levels[factor]].add(size[part])
        values = {value for found in by_level.values() for value in found}
        if 1 < len(by_level) == len(values) and all(len(found) == 1 for found in by_level.values()):
            return True
    return False


def _point(trial: TrialRow, names: Sequence[str]) -> NDArray[np.float64]:
    return np.array([trial.numbers[name] for name in names])


def _merged(values: Sequence[float]) -> dict[float, float]:
    """Return the mean of the group of each value. Ratios within a group are at most `MAX_SIZE_RATIO`."""
    groups: list[list[float]] = []
    for value in sorted(set(values)):
        if not groups or value > groups[-1][0] * MAX_SIZE_RATIO:
            groups.append([])
        groups[-1].append(value)
    return {value: sum(group) / len(group) for group in groups for value in group}


class Effective(NamedTuple):
    """A sequence of trials with one distance and one width, as it was done: means along the movement."""

    distance: float
    width: float
    """4.133 standard deviations of the errors."""
    seconds: float

    @property
    def bits(self) -> float:
        """Effective index of difficulty, bit."""
        return float(np.log2(self.distance / self.width + 1))

    @property
    def throughput(self) -> float:
        """Throughput, bit/s."""
        return self.bits / self.seconds


def effective(distance: Array, error: Array, before: Array, seconds: Array) -> Effective:
    """Return the effective distance and width of a sequence of trials, of arrays of shape (n,).

    `error` is positive beyond the target, NaN if the trial is left out. `before` is the error with which the
    movement before ended, where this one begins: it is added to the distance. NaN if not known, or if the
    trial begins at the centre of the target before.
    """
    moved = distance + error + np.nan_to_num(before)
    known = ~np.isnan(error)
    width = WIDTHS_PER_SD * float(error[known].std(ddof=1))
    return Effective(float(moved[known].mean()), width, float(seconds[known].mean()))


def groups_of_participants(trials: Trials, groups: Iterable[Group]) -> dict[str, list[Group]]:
    """Return the groups that each participant should have: by its between-subject levels."""
    between = [factor for factor in trials.factors if not trials.is_within(factor)]
    own = {
        row.participant: {name: row.levels[trials.index(name)] for name in between} for row in trials.counted
    }
    all_groups = list(dict.fromkeys(groups))
    return {
        participant: [
            group for group in all_groups if all(levels.get(name, level) == level for name, level in group)
        ]
        for participant, levels in own.items()
    }


def bits(distance: Array, width: Array, index: Index = "m") -> Array:
    """Return the index of difficulty: log2(D / W + 1), bit; for `kopper` log2(D / W³ + 1)², of degrees."""
    if index == "kopper":
        return np.asarray(np.log2(distance / width**KOPPER_EXPONENT + 1) ** 2)
    return np.asarray(np.log2(distance / width + 1))


class FittsPoints(NamedTuple):
    """Times of a condition by difficulty, of participants who have all sizes in each of their conditions."""

    bits: Array
    """Indices of difficulty, shape (k,)."""
    times: Array
    """Means of the hits of each participant, shape (n, k), s."""
    left_out: int
    """Number of the other participants."""


def fitts_points(trials: Trials, index: Index = "m") -> dict[Group, FittsPoints]:
    """Return the points of the regression of each condition that has three indices of difficulty."""
    names = ("target_distance_deg", "target_width_deg")
    cells: dict[Group, dict[tuple[float, float], list[TrialRow]]] = defaultdict(lambda: defaultdict(list))
    for each in movements(trials):
        if each.trial.outcome == "hit" and (index == "m" or each.trial.numbers.keys() >= {*names}):
            cells[each.group][each.size_m].append(each.trial)
    difficulty = {group: _difficulty(sizes, index) for group, sizes in cells.items()}
    cells = {group: cells[group] for group, values in difficulty.items() if len({*values.tolist()}) >= 3}
    own_groups = groups_of_participants(trials, cells)
    times = {group: _times(sizes) for group, sizes in cells.items()}
    whole = {
        group: {name for name, own in people.items() if None not in own} for group, people in times.items()
    }
    points_by_group: dict[Group, FittsPoints] = {}
    for group, people in times.items():
        own = [
            people[name] for name in sorted(people) if all(name in whole[each] for each in own_groups[name])
        ]
        points = np.array(own, dtype=np.float64).reshape(-1, len(cells[group]))
        points_by_group[group] = FittsPoints(difficulty[group], points, len(people) - len(own))
    return points_by_group


def _times(sizes: Mapping[tuple[float, float], Sequence[TrialRow]]) -> dict[str, list[float | None]]:
    """Return each participant's mean time for each of the sorted `sizes`, s, None if they have no hit."""
    found: dict[str, list[float | None]] = {}
    for name in {row.participant for rows in sizes.values() for row in rows}:
        own = [
            [row.numbers["selection_s"] for row in sizes[size] if row.participant == name]
            for size in sorted(sizes)
        ]
        found[name] = [float(np.mean(each)) if each else None for each in own]
    return found


def _difficulty(sizes: Mapping[tuple[float, float], Sequence[TrialRow]], index: Index) -> Array:
    """Return the index of difficulty of each of the sorted `sizes`, in degrees of their trials' means."""
    if index == "m":
        distance, width = np.array(sorted(sizes)).T
        return bits(distance, width)
    names = ("target_distance_deg", "target_width_deg")
    means = [
        np.mean([[row.numbers[name] for name in names] for row in sizes[size]], axis=0)
        for size in sorted(sizes)
    ]
    distance, width = np.array(means).T
    return bits(distance, width, index)


def fitts(trials: Trials, index: Index = "m") -> Table:
    """Return the regression of the time over the index of difficulty, of each `Group`.

    The points are the means over participants. Intervals are bootstrap intervals over participants.
    `left_out` is the number of participants who lack a distance or width here or in another condition.

    Raises: ConfigError: If no condition has three indices of difficulty.
    """
    table = Table()
    for group, (difficulty, whole, left_out) in fitts_points(trials, index).items():
        if not len(whole):
            continue
        fit = stats.linregress(difficulty, whole.mean(axis=0))
        limits: list[float | None] = [None] * 4
        if len(whole) > 1:
            resampled = whole[resample_indices(len(whole))].mean(axis=1)
            centred = difficulty - difficulty.mean()
            slopes = resampled @ centred / (centred @ centred)
            limits = [
                *percentile_interval(resampled.mean(axis=1) - slopes * difficulty.mean()),
                *percentile_interval(slopes),
            ]
        row: dict[str, Any] = {
            "participants": len(whole),
            "points": len(difficulty),
            "intercept_s": float(fit.intercept),
        }
        row |= {"intercept_low": limits[0], "intercept_high": limits[1], "slope_s_per_bit": float(fit.slope)}
        row |= {"slope_low": limits[2], "slope_high": limits[3], "r2": float(fit.rvalue) ** 2}
        table.append({**dict(group), **row, "left_out": left_out})
    if not table:
        raise ConfigError(
            f"{trials.folder}: no condition has three different distances or widths of all its"
            " participants, so there is no regression; add targets of other sizes"
        )
    return table


def length_in(movement: Movement, unit: Unit) -> tuple[float, float, float]:
    """Return distance, error along the line and the error before in `unit`."""
    if unit == "m":
        return movement.distance_m, movement.error_m, movement.before_m
    numbers = movement.trial.numbers
    degrees_per_m = numbers["target_width_deg"] / numbers["target_width_m"]
    return numbers["target_distance_deg"], movement.error_m * degrees_per_m, movement.before_m * degrees_per_m


class TapSequence(NamedTuple):
    """The movements of a participant in a block with one condition, distance and width."""

    group: Group
    participant: str
    size_m: tuple[float, float]
    measured: int
    """Number of movements that end with a selection."""
    gross: int
    """Number of them with an error of more than half the distance, which are left out."""
    effective: Effective | None
    """None if fewer than `MIN_SEQUENCE_TRIALS` are left."""


class Sequences(NamedTuple):
    """The sequences of a study by their use for its throughput."""

    groups: tuple[Group, ...]
    """All conditions, in their order."""
    used: list[TapSequence]
    """Sequences of participants who have one of the same size in each of their conditions."""
    unmatched: list[TapSequence]
    """Sequences that have no counterpart in another condition."""
    short: list[TapSequence]
    """Sequences with too few selections."""
    trials: Counter[Group]
    """Number of counted trials."""
    movements: Counter[Group]
    """Number of trials that began at a known target."""


def sequences(trials: Trials, unit: Unit = "m") -> Sequences:
    """Return the sequences of tapping of a study.

    A sequence is the trials of a block with the same condition, distance and width. A movement begins at the
    target before, so that a block's first trial is not counted. Selections further from the target than half
    the distance are gross errors and left out (Soukoreff and MacKenzie, 2004). Times include reaction and
    dwell. Errors in degrees are those in metres, at the distance of the target.
    """
    all_movements = movements(trials)
    kept = [name for name, _ in all_movements[0].group] if all_movements else []
    by_trial = [tuple((name, row.levels[trials.index(name)]) for name in kept) for row in trials.counted]
    by_key: dict[tuple[object, ...], list[Movement]] = defaultdict(list)
    for each in all_movements:
        by_key[each.trial.participant, each.trial.block, each.trial.levels, each.size_m].append(each)
    found = [_sequence(each, unit) for each in by_key.values()]
    valid = [each for each in found if each.effective is not None]
    own_groups = groups_of_participants(trials, [each.group for each in valid])
    there = {(each.group, each.participant, each.size_m) for each in valid}
    is_matched = [
        all((group, each.participant, each.size_m) in there for group in own_groups[each.participant])
        for each in valid
    ]
    return Sequences(
        groups=tuple(dict.fromkeys(sorted(by_trial, key=lambda group: _place(trials, group)))),
        used=[each for each, is_used in zip(valid, is_matched, strict=True) if is_used],
        unmatched=[each for each, is_used in zip(valid, is_matched, strict=True) if not is_used],
        short=[each for each in found if each.effective is None],
        trials=Counter(by_trial),
        movements=Counter(each.group for each in all_movements),
    )


def _place(trials: Trials, group: Group) -> list[int]:
    return [trials.levels(name).index(level) for name, level in group]


def _sequence(own_movements: Sequence[Movement], unit: Unit) -> TapSequence:
    needed = {"selection_s", f"target_distance_{unit}", f"target_width_{unit}"}
    measured = [
        each
        for each in own_movements
        if each.trial.outcome in ("hit", "wrong")
        and not np.isnan(each.error_m)
        and each.trial.numbers.keys() >= needed
    ]
    parts = np.array([length_in(each, unit) for each in measured]).reshape(-1, 3)
    distance, error, before = parts.T
    far = np.abs(error) > distance / 2
    error[far] = np.nan
    found = None
    if np.sum(~far) >= MIN_SEQUENCE_TRIALS and np.nanstd(error) > 0:
        seconds = np.array([each.trial.numbers["selection_s"] for each in measured])
        found = effective(distance, error, before, seconds)
    first = own_movements[0]
    return TapSequence(
        first.group, first.trial.participant, first.size_m, len(measured), int(far.sum()), found
    )


def throughput(trials: Trials, unit: Unit = "m") -> Table:
    """Return the throughput of each `Group`: the mean over participants of the means of their `sequences`.

    All conditions are of the same participants, distances and widths, but for factors between participants.
    `left_out` is the number of movements that are not in it, which `omissions` explains.

    Raises: ConfigError: If no participant has a sequence in each of their conditions.
    """
    found = sequences(trials, unit)
    if not found.used:
        total = len(found.short) + len(found.unmatched)
        raise ConfigError(
            f"{trials.folder}: no participant has {MIN_SEQUENCE_TRIALS} selections in a row with one distance"
            f" and width in {unit} in each condition, so there is no throughput (it is of tapping tasks): of"
            f" {total} sequences {len(found.short)} are shorter, {len(found.unmatched)} have no counterpart"
        )
    names = ("effective_bits", f"effective_distance_{unit}", f"effective_width_{unit}", "movement_s")
    table = Table()
    for group in found.groups:
        own = [each for each in found.used if each.group == group]
        people: dict[str, list[tuple[float, ...]]] = defaultdict(list)
        for each in own:
            if (made := each.effective) is not None:
                people[each.participant].append((made.throughput, made.bits, *made))
        means = np.array([np.mean(each, axis=0) for each in people.values()]).reshape(-1, 5)
        columns = summary(means[:, 0].tolist(), "throughput_bit_per_s", np.mean, sequences=len(own))
        mean = means.mean(axis=0)[1:].tolist() if len(means) else [None] * len(names)
        used = sum(each.measured - each.gross for each in own)
        left_out = {"left_out": found.movements[group] - used}
        table.append({**dict(group), **columns, **dict(zip(names, mean, strict=True)), **left_out})
    return table


def omissions(trials: Trials, unit: Unit = "m") -> Table:
    """Return for each `Group` the number of counted trials, and of those that are not in its throughput.

    `no_start`: the first of a block, or the trial before has no target. `no_selection`: nothing was selected,
    or a size is not known. `gross_errors`: see `sequences`. `in_short_sequences`: of fewer selections than
    `MIN_SEQUENCE_TRIALS`. `in_unmatched_sequences`: the participant has none of that size in another
    condition.
    """
    found = sequences(trials, unit)
    table = Table()
    for group in found.groups:
        used, unmatched, short = (
            [each for each in kind if each.group == group]
            for kind in (found.used, found.unmatched, found.short)
        )
        measured = sum(each.measured for each in (*used, *unmatched, *short))
        row: dict[str, Any] = {**dict(group), "trials": found.trials[group]}
        row["used"] = sum(each.measured - each.gross for each in used)
        row["no_start"] = found.trials[group] - found.movements[group]
        row["no_selection"] = found.movements[group] - measured
        row["gross_errors"] = sum(each.gross for each in (*used, *unmatched, *short))
        row["in_short_sequences"] = sum(each.measured - each.gross for each in short)
        row["in_unmatched_sequences"] = sum(each.measured - each.gross for each in unmatched)
        row |= {"sequences": len(used), "short_sequences": len(short)}
        table.append({**row, "unmatched_sequences": len(unmatched)})
    return table


def omission_notes(trials: Trials, unit: Unit = "m") -> list[str]:
    """Return a sentence for each condition whose throughput lacks sequences, none without a throughput."""
    notes: list[str] = []
    table = omissions(trials, unit)
    for row in table if any(row["used"] for row in table) else ():
        short = row["short_sequences"]
        unmatched = row["unmatched_sequences"]
        if short or unmatched:
            name = trials.label(row[factor] for factor in trials.factors if factor in row)
            total = row["sequences"] + short + unmatched
            notes.append(
                f"Throughput of {name} in {unit}: {short + unmatched} of {total} sequences are left out,"
                f" {short} with fewer than {MIN_SEQUENCE_TRIALS} selections and {unmatched} without a"
                " counterpart in another condition."
            )
    return notes
