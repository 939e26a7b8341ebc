"""Throughput of tapping: sequences, the comparable ones, and the excluded ones."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pointit.errors import ConfigError
from pointit.study.plan import MIN_SEQUENCE_TRIALS
from pointit.study_report.table import Table, summary
from pointit.study_report.tapping_movements import (
    Effective,
    Group,
    Movement,
    Unit,
    effective,
    groups_of_participants,
    length_in,
    movements,
)
from pointit.study_report.trial_row import Trials


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
    found, table = sequences(trials, unit), Table()
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
        short, unmatched = row["short_sequences"], row["unmatched_sequences"]
        if short or unmatched:
            name = trials.label(row[factor] for factor in trials.factors if factor in row)
            total = row["sequences"] + short + unmatched
            notes.append(
                f"Throughput of {name} in {unit}: {short + unmatched} of {total} sequences are left out,"
                f" {short} with fewer than {MIN_SEQUENCE_TRIALS} selections and {unmatched} without a"
                " counterpart in another condition."
            )
    return notes
