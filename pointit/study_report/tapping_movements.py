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

import itertools
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
Size = tuple[float, float]
"""Distance and width, m."""
Limits = tuple[float | None, float | None]
"""Ends of an interval. None if there is none."""
Group = tuple[tuple[str, str], ...]
"""Levels by factor, without the factors that set the distance or the width, of which difficulty is made."""

WIDTHS_PER_SD = float(np.sqrt(2 * np.pi * np.e))
"""4.133: the width that 96 % of normally distributed selections hit, in standard deviations."""
ANGLES = ("target_distance_deg", "target_width_deg")
"""Columns of a trial's size in degrees."""
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
    size_m: Size = (0.0, 0.0)
    """Distance and width, where those that are nearly equal are the same."""
    group: Group = ()


def movements(trials: Trials) -> list[Movement]:
    """Return the movements of all counted trials with a width, a target and a target before, by condition."""
    measured = _measured_movements(trials.counted)
    measured.sort(key=lambda movement: trials.conditions.index(movement.trial.levels))

    # Sizes that are nearly equal become one: targets are built by hand.
    distances = _merged([movement.distance_m for movement in measured])
    widths = _merged([movement.trial.numbers["target_width_m"] for movement in measured])
    sizes: list[Size] = []
    for movement in measured:
        distance_m = distances[movement.distance_m]
        width_m = widths[movement.trial.numbers["target_width_m"]]
        sizes.append((distance_m, width_m))

    # A factor that sets the size is no condition: its levels are points of one regression.
    factors: list[str] = []
    for factor in trials.factors:
        if not _sets_size(trials.index(factor), measured, sizes):
            factors.append(factor)
    results: list[Movement] = []
    for movement, size in zip(measured, sizes, strict=True):
        group = _group_of(trials, movement.trial, factors)
        results.append(movement._replace(size_m=size, group=group))
    return results


def _measured_movements(rows: Sequence[TrialRow]) -> list[Movement]:
    """Return the movements between trials that follow each other in a block, without size and group."""
    results: list[Movement] = []
    error_m = np.nan
    for start, row in itertools.pairwise(rows):
        previous_error_m = error_m
        error_m = np.nan
        if (start.participant, start.block) != (row.participant, row.block):
            continue
        if not _has_numbers(start, TARGET) or not _has_numbers(row, TARGET):
            continue
        target = _point(row, TARGET)
        line = target - _point(start, TARGET)
        distance_m = float(np.linalg.norm(line))
        has_size = distance_m > 0 and row.numbers.get("target_width_m", 0) > 0
        if not has_size:
            continue
        if _has_numbers(row, SELECTED):
            selection_error = _point(row, SELECTED) - target
            error_m = float(selection_error @ line) / distance_m
        results.append(Movement(row, distance_m, error_m, previous_error_m))
    return results


def _group_of(trials: Trials, row: TrialRow, factors: Iterable[str]) -> Group:
    return tuple((factor, row.levels[trials.index(factor)]) for factor in factors)


def _sets_size(factor: int, all_movements: Sequence[Movement], sizes: Sequence[Size]) -> bool:
    """Return True if each level of a factor has one distance of its own, or one width."""
    for part in (0, 1):
        by_level: dict[str, set[float]] = defaultdict(set)
        for movement, size in zip(all_movements, sizes, strict=True):
            level = movement.trial.levels[factor]
            by_level[level].add(size[part])
        values = set[float]().union(*by_level.values())
        has_one_each = all(len(own_values) == 1 for own_values in by_level.values())
        if has_one_each and 1 < len(by_level) == len(values):
            return True
    return False


def _has_numbers(trial: TrialRow, names: Iterable[str]) -> bool:
    return all(name in trial.numbers for name in names)


def _point(trial: TrialRow, names: Sequence[str]) -> NDArray[np.float64]:
    return np.array([trial.numbers[name] for name in names])


def _merged(values: Sequence[float]) -> dict[float, float]:
    """Return the mean of the group of each value. Ratios within a group are at most `MAX_SIZE_RATIO`."""
    groups: list[list[float]] = []
    for value in sorted(set(values)):
        if groups and value <= groups[-1][0] * MAX_SIZE_RATIO:
            groups[-1].append(value)
        else:
            groups.append([value])
    means: dict[float, float] = {}
    for group in groups:
        mean = sum(group) / len(group)
        for value in group:
            means[value] = mean
    return means


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
    amplitudes = distance + error + np.nan_to_num(before)
    is_used = ~np.isnan(error)
    width = WIDTHS_PER_SD * float(error[is_used].std(ddof=1))
    mean_distance = float(amplitudes[is_used].mean())
    return Effective(mean_distance, width, float(seconds[is_used].mean()))


def groups_of_participants(trials: Trials, groups: Iterable[Group]) -> dict[str, list[Group]]:
    """Return the groups that each participant should have: by its between-subject levels."""
    between = [factor for factor in trials.factors if not trials.is_within(factor)]
    own_levels: dict[str, dict[str, str]] = {}
    for row in trials.counted:
        own_levels[row.participant] = dict(_group_of(trials, row, between))
    all_groups = list(dict.fromkeys(groups))
    own_groups: dict[str, list[Group]] = {}
    for participant, levels in own_levels.items():
        own_groups[participant] = [group for group in all_groups if _is_group_of(group, levels)]
    return own_groups


def _is_group_of(group: Group, levels: Mapping[str, str]) -> bool:
    """Return True if a group has the levels that a participant has of factors between participants."""
    return all(levels.get(name, level) == level for name, level in group)


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
    # Hits by condition and size; for an index of angles, those whose angles are known.
    needed = () if index == "m" else ANGLES
    hits: dict[Group, dict[Size, list[TrialRow]]] = {}
    for movement in movements(trials):
        trial = movement.trial
        if trial.outcome == "hit" and _has_numbers(trial, needed):
            by_size = hits.setdefault(movement.group, defaultdict(list))
            by_size[movement.size_m].append(trial)

    # A regression needs three difficulties.
    difficulties: dict[Group, Array] = {}
    for group, sizes in hits.items():
        difficulty = _difficulty(sizes, index)
        if len({*difficulty.tolist()}) >= 3:
            difficulties[group] = difficulty

    # Conditions are compared over the same participants: those with a hit of each size in each of theirs.
    own_groups = groups_of_participants(trials, difficulties)
    times = {group: _times(hits[group]) for group in difficulties}
    complete: dict[Group, set[str]] = {}
    for group, people in times.items():
        complete[group] = {name for name, own_times in people.items() if None not in own_times}

    points_by_group: dict[Group, FittsPoints] = {}
    for group, people in times.items():
        used_times: list[list[float | None]] = []
        for name in sorted(people):
            if all(name in complete[own_group] for own_group in own_groups[name]):
                used_times.append(people[name])
        size_count = len(hits[group])
        points = np.array(used_times, dtype=np.float64).reshape(-1, size_count)
        left_out = len(people) - len(used_times)
        points_by_group[group] = FittsPoints(difficulties[group], points, left_out)
    return points_by_group


def _times(sizes: Mapping[Size, Sequence[TrialRow]]) -> dict[str, list[float | None]]:
    """Return each participant's mean time for each of the sorted `sizes`, s, None if they have no hit."""
    times: dict[str, list[float | None]] = {}
    for rows in sizes.values():
        for row in rows:
            times[row.participant] = []
    for size in sorted(sizes):
        own_times: dict[str, list[float]] = defaultdict(list)
        for row in sizes[size]:
            own_times[row.participant].append(row.numbers["selection_s"])
        for participant, means in times.items():
            seconds = own_times.get(participant)
            means.append(float(np.mean(seconds)) if seconds else None)
    return times


def _difficulty(sizes: Mapping[Size, Sequence[TrialRow]], index: Index) -> Array:
    """Return the index of difficulty of each of the sorted `sizes`, in degrees of their trials' means."""
    if index == "m":
        distance, width = np.array(sorted(sizes)).T
        return bits(distance, width)
    means: list[Array] = []
    for size in sorted(sizes):
        angles = np.array([_point(row, ANGLES) for row in sizes[size]])
        means.append(np.mean(angles, axis=0))
    distance, width = np.array(means).T
    return bits(distance, width, index)


def fitts(trials: Trials, index: Index = "m") -> Table:
    """Return the regression of the time over the index of difficulty, of each `Group`.

    The points are the means over participants. Intervals are bootstrap intervals over participants.
    `left_out` is the number of participants who lack a distance or width here or in another condition.

    Raises: ConfigError: If no condition has three indices of difficulty.
    """
    table = Table()
    for group, (difficulty, times, left_out) in fitts_points(trials, index).items():
        if not len(times):
            continue
        fit = stats.linregress(difficulty, times.mean(axis=0))

        # The least-squares line of each resampled group of participants, all at once.
        intercept_limits: Limits = (None, None)
        slope_limits: Limits = (None, None)
        if len(times) > 1:
            resampled = times[resample_indices(len(times))].mean(axis=1)
            centred = difficulty - difficulty.mean()
            slopes = resampled @ centred / (centred @ centred)
            intercepts = resampled.mean(axis=1) - slopes * difficulty.mean()
            intercept_limits = percentile_interval(intercepts)
            slope_limits = percentile_interval(slopes)

        row: dict[str, Any] = {
            **dict(group),
            "participants": len(times),
            "points": len(difficulty),
            "intercept_s": float(fit.intercept),
            "intercept_low": intercept_limits[0],
            "intercept_high": intercept_limits[1],
            "slope_s_per_bit": float(fit.slope),
            "slope_low": slope_limits[0],
            "slope_high": slope_limits[1],
            "r2": float(fit.rvalue) ** 2,
            "left_out": left_out,
        }
        table.append(row)
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
    error_deg = movement.error_m * degrees_per_m
    before_deg = movement.before_m * degrees_per_m
    return numbers["target_distance_deg"], error_deg, before_deg


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
    factors: list[str] = []
    if all_movements:
        factors = [name for name, _ in all_movements[0].group]
    trial_groups = [_group_of(trials, row, factors) for row in trials.counted]

    by_key: dict[tuple[object, ...], list[Movement]] = defaultdict(list)
    for movement in all_movements:
        trial = movement.trial
        key = (trial.participant, trial.block, trial.levels, movement.size_m)
        by_key[key].append(movement)
    all_sequences = [_sequence(own_movements, unit) for own_movements in by_key.values()]
    valid = [sequence for sequence in all_sequences if sequence.effective is not None]
    short = [sequence for sequence in all_sequences if sequence.effective is None]

    # Conditions are compared over the same participants and sizes.
    own_groups = groups_of_participants(trials, [sequence.group for sequence in valid])
    valid_keys = {(sequence.group, sequence.participant, sequence.size_m) for sequence in valid}
    used: list[TapSequence] = []
    unmatched: list[TapSequence] = []
    for sequence in valid:
        participant = sequence.participant
        counterparts = {(group, participant, sequence.size_m) for group in own_groups[participant]}
        if counterparts <= valid_keys:
            used.append(sequence)
        else:
            unmatched.append(sequence)

    groups = sorted(set(trial_groups), key=lambda group: _place(trials, group))
    movement_counts = Counter(movement.group for movement in all_movements)
    return Sequences(
        groups=tuple(groups),
        used=used,
        unmatched=unmatched,
        short=short,
        trials=Counter(trial_groups),
        movements=movement_counts,
    )


def _place(trials: Trials, group: Group) -> list[int]:
    return [trials.levels(name).index(level) for name, level in group]


def _sequence(own_movements: Sequence[Movement], unit: Unit) -> TapSequence:
    needed = ("selection_s", f"target_distance_{unit}", f"target_width_{unit}")
    measured: list[Movement] = []
    for movement in own_movements:
        if movement.trial.outcome not in ("hit", "wrong") or np.isnan(movement.error_m):
            continue
        if _has_numbers(movement.trial, needed):
            measured.append(movement)

    lengths = [length_in(movement, unit) for movement in measured]
    distance, error, before = np.array(lengths).reshape(-1, 3).T
    is_gross = np.abs(error) > distance / 2
    error[is_gross] = np.nan

    # A few selections, or all at one place, have no effective width.
    result: Effective | None = None
    if np.sum(~is_gross) >= MIN_SEQUENCE_TRIALS and np.nanstd(error) > 0:
        seconds = [movement.trial.numbers["selection_s"] for movement in measured]
        result = effective(distance, error, before, np.array(seconds))
    first = own_movements[0]
    return TapSequence(
        group=first.group,
        participant=first.trial.participant,
        size_m=first.size_m,
        measured=len(measured),
        gross=int(is_gross.sum()),
        effective=result,
    )


def throughput(trials: Trials, unit: Unit = "m") -> Table:
    """Return the throughput of each `Group`: the mean over participants of the means of their `sequences`.

    All conditions are of the same participants, distances and widths, but for factors between participants.
    `left_out` is the number of movements that are not in it, which `omissions` explains.

    Raises: ConfigError: If no participant has a sequence in each of their conditions.
    """
    all_sequences = sequences(trials, unit)
    if not all_sequences.used:
        short = len(all_sequences.short)
        unmatched = len(all_sequences.unmatched)
        raise ConfigError(
            f"{trials.folder}: no participant has {MIN_SEQUENCE_TRIALS} selections in a row with one distance"
            f" and width in {unit} in each condition, so there is no throughput (it is of tapping tasks): of"
            f" {short + unmatched} sequences {short} are shorter, {unmatched} have no counterpart"
        )
    names = ("effective_bits", f"effective_distance_{unit}", f"effective_width_{unit}", "movement_s")
    table = Table()
    for group in all_sequences.groups:
        own = _of_group(all_sequences.used, group)
        people: dict[str, list[tuple[float, ...]]] = defaultdict(list)
        for sequence in own:
            result = sequence.effective
            if result is not None:
                values = (result.throughput, result.bits, *result)
                people[sequence.participant].append(values)

        # Means of the sequences of each participant, then over participants.
        own_means = [np.mean(own_values, axis=0) for own_values in people.values()]
        means = np.array(own_means).reshape(-1, 5)
        throughputs: list[float] = means[:, 0].tolist()
        columns = summary(throughputs, "throughput_bit_per_s", np.mean, sequences=len(own))
        mean: list[float | None] = [None] * len(names)
        if len(means):
            mean = means.mean(axis=0)[1:].tolist()
        left_out = all_sequences.movements[group] - _used_count(own)
        further = dict(zip(names, mean, strict=True))
        table.append({**dict(group), **columns, **further, "left_out": left_out})
    return table


def _of_group(all_sequences: Iterable[TapSequence], group: Group) -> list[TapSequence]:
    return [sequence for sequence in all_sequences if sequence.group == group]


def _used_count(own_sequences: Iterable[TapSequence]) -> int:
    """Return the number of selections in sequences without gross errors."""
    return sum(sequence.measured - sequence.gross for sequence in own_sequences)


def omissions(trials: Trials, unit: Unit = "m") -> Table:
    """Return for each `Group` the number of counted trials, and of those that are not in its throughput.

    `no_start`: the first of a block, or the trial before has no target. `no_selection`: nothing was selected,
    or a size is not known. `gross_errors`: see `sequences`. `in_short_sequences`: of fewer selections than
    `MIN_SEQUENCE_TRIALS`. `in_unmatched_sequences`: the participant has none of that size in another
    condition.
    """
    all_sequences = sequences(trials, unit)
    table = Table()
    for group in all_sequences.groups:
        used = _of_group(all_sequences.used, group)
        unmatched = _of_group(all_sequences.unmatched, group)
        short = _of_group(all_sequences.short, group)
        trial_count = all_sequences.trials[group]
        movement_count = all_sequences.movements[group]

        # Each trial is counted once: used, or by the first reason for which it is not.
        own = [*used, *unmatched, *short]
        measured = sum(sequence.measured for sequence in own)
        gross_errors = sum(sequence.gross for sequence in own)
        row: dict[str, Any] = {
            **dict(group),
            "trials": trial_count,
            "used": _used_count(used),
            "no_start": trial_count - movement_count,
            "no_selection": movement_count - measured,
            "gross_errors": gross_errors,
            "in_short_sequences": _used_count(short),
            "in_unmatched_sequences": _used_count(unmatched),
            "sequences": len(used),
            "short_sequences": len(short),
            "unmatched_sequences": len(unmatched),
        }
        table.append(row)
    return table


def omission_notes(trials: Trials, unit: Unit = "m") -> list[str]:
    """Return a sentence for each condition whose throughput lacks sequences, none without a throughput."""
    table = omissions(trials, unit)
    if not any(row["used"] for row in table):
        return []
    notes: list[str] = []
    for row in table:
        short = row["short_sequences"]
        unmatched = row["unmatched_sequences"]
        left_out = short + unmatched
        if left_out:
            name = trials.label(row[factor] for factor in trials.factors if factor in row)
            total = row["sequences"] + left_out
            notes.append(
                f"Throughput of {name} in {unit}: {left_out} of {total} sequences are left out,"
                f" {short} with fewer than {MIN_SEQUENCE_TRIALS} selections and {unmatched} without a"
                " counterpart in another condition."
            )
    return notes
